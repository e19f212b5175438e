"""Sound of a stroke: what a microphone a hand's breadth above the specimen hears of it.

Three sources are heard through the board under the specimen, which rings. The tool's acceleration,
worked out as for a trace, radiates as a small source does: the higher the frequency, the better.
Asperities below the fine roughness hiss while they are rubbed, far beyond what an accelerometer
reaches: the louder the rougher the surface and the harder and faster it is rubbed, the brighter the
finer it is. A loose foil, where there is one, rustles with the hand and not with the surface. The
noise of the room is always the same, so it hides what is quiet.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tex_lightning.synthetic.materials import Voice
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import MASS, Signal, Stroke, accelerate, drift

GAIN = 0.012  # full scale per m/s^2 of a source
_RADIATION_HZ = 900.0  # below it a small source is hardly heard
_HISS = 8.0  # m/s^2 at a friction of 1 and a fine roughness of 1 um, 1 N and 90 mm/s
_ASPERITIES = 16  # rubbed at once along one wavelength of the fine roughness
_RUSTLE, _CRACKLE_HZ = 2.0, 25.0  # m/s^2 at 1 N and 90 mm/s; how fast the foil crackles
_MODES = (1.0, 2.2, 3.9)  # ringing of a board, in multiples of its pitch
_MODE_GAIN = 5.0
_ROOM, _ROOM_HZ, _SELF_NOISE = 0.002, 400.0, 0.001  # of full scale


def hear_stroke(
    specimen: Specimen, stroke: Stroke, contact: np.random.Generator, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Record the sound of one stroke, which is at the rate of the sound.

    What varies in the contact comes from ``contact``, as :func:`~.tool.accelerate` takes it, and
    what only the microphone hears from ``rng``.

    Returns:
        Sound pressure, shape (T,), full scale at +-1; what is louder saturates softly.
    """
    rate, voice = stroke.sampling_rate, specimen.material.voice
    shaken = accelerate(specimen, stroke, contact)
    radiated = _filtered(shaken[0] + shaken[2], _RADIATION_HZ, rate, "highpass")
    source = radiated + _hiss(specimen, stroke, shaken[2], rng)
    source *= voice.loudness
    if voice.rustle > 0:
        source += voice.rustle * _rustle(stroke, rng)
    heard = GAIN * _ring_board(source, voice, rate) + _room(len(source), rate, rng)
    return np.tanh(heard).astype(np.float32)


def _hiss(specimen: Specimen, stroke: Stroke, normal: Signal, rng: np.random.Generator) -> Signal:
    """Rub asperities: noise that follows the pressure of the contact and the speed."""
    body = specimen.material.body
    # Nothing rubs while the tool hops; the pressure is bounded as the surface gives way.
    load = np.clip(stroke.force + MASS * normal, 0, 3 * stroke.force)
    level = _HISS * body.friction * 1e3 * body.micro_depth
    rubbed = load * np.power(stroke.speed / 90, 1.5) * rng.standard_normal(len(normal))
    speed = max(float(stroke.speed.mean()), 1.0)
    hertz = min(speed * _ASPERITIES / body.micro_wavelength, 0.45 * stroke.sampling_rate)
    return level * _filtered(rubbed, hertz, stroke.sampling_rate, "lowpass")


def _rustle(stroke: Stroke, rng: np.random.Generator) -> Signal:
    """Let the foil crackle while the hand moves; it never lies the same way twice."""
    rate, count = stroke.sampling_rate, len(stroke.speed)
    crackle = np.exp(0.7 * drift(rng, count, rate, _CRACKLE_HZ))
    lay = np.exp(0.4 * np.clip(rng.standard_normal(), -2, 2))
    moved: Signal = stroke.force * stroke.speed / 90 * crackle * rng.standard_normal(count)
    moved *= _RUSTLE * lay
    return moved


def _ring_board(source: Signal, voice: Voice, rate: int) -> Signal:
    heard = source.copy()
    for mode in _MODES:
        if (hertz := mode * voice.pitch) < 0.45 * rate:
            b, a = signal.iirpeak(hertz, voice.quality, rate)
            heard += _MODE_GAIN * signal.lfilter(b, a, source)
    return heard


def _room(count: int, rate: int, rng: np.random.Generator) -> Signal:
    """Noise of fixed level: the room's, which is low, and the microphone's own."""
    low = _filtered(rng.standard_normal(count), _ROOM_HZ, rate, "lowpass")
    return _ROOM * low / low.std() + _SELF_NOISE * rng.standard_normal(count)


def _filtered(source: Signal, hertz: float, rate: int, kind: str) -> Signal:
    b, a = signal.butter(1, hertz, kind, fs=rate)
    return signal.lfilter(b, a, source)
