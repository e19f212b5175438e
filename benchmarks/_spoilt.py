"""Changes of one signal (axes, samples) or photo (height, width, 3) uint8 that change no material.

Each takes a value and a :class:`Scene`, as the package's perturbations do.
"""

from typing import Any

import numpy as np
import numpy.typing as npt
import scipy

from tex_lightning.perturbations import pixels, traces
from tex_lightning.perturbations.pixels import Scene

Array = npt.NDArray[Any]


def deviation(trace: Array) -> float:
    """Return the deviation of a trace (axes, samples) about the means of its axes."""
    return float(np.sqrt(traces.power(trace)))


def gain(trace: Array, factor: float, scene: Scene) -> Array:
    """Multiply by a factor; a negative one turns the sensor round."""
    return trace * factor


def any_gain(trace: Array, decibel: float, scene: Scene) -> Array:
    """Multiply every recording by another gain, up to ``decibel`` either way."""
    return trace * 10 ** (scene.rng.uniform(-decibel, decibel) / 20)


def offset(trace: Array, times: float, scene: Scene) -> Array:
    """Add a constant of so many deviations."""
    return trace + times * deviation(trace)


def drift(trace: Array, times: float, scene: Scene) -> Array:
    """Add a ramp that rises by so many deviations."""
    return trace + times * deviation(trace) * np.linspace(0, 1, trace.shape[1])


def tilt(trace: Array, times: float, scene: Scene) -> Array:
    """Add a sway of 0.3 to 1.5 Hz of so many deviations: gravity, as a tool in a hand tilts."""
    cycles = scene.rng.uniform(0.3, 1.5) * np.arange(trace.shape[1]) / scene.rate
    strength = times * 2**0.5 * deviation(trace)
    return trace + strength * np.sin(2 * np.pi * (cycles + scene.rng.random()))


def flat(trace: Array, value: None, scene: Scene) -> Array:
    """Hold the first sample: the cable came off."""
    return np.broadcast_to(trace[:, :1], trace.shape).copy()


def three_axes(trace: Array, value: None, scene: Scene) -> Array:
    """Lay a single axis along a fixed direction of three."""
    return np.array([[0.36], [0.48], [0.8]]) * trace.mean(axis=0, keepdims=True)


def turned_axes(trace: Array, degrees: float, scene: Scene) -> Array:
    """Turn three axes about any direction, as of a sensor that is mounted askew."""
    direction = scene.rng.standard_normal(3)
    turn = np.deg2rad(degrees) * direction / np.linalg.norm(direction)
    return scipy.spatial.transform.Rotation.from_rotvec(turn).as_matrix() @ trace


def swapped_axes(trace: Array, value: None, scene: Scene) -> Array:
    """Number the axes the other way round."""
    return trace[::-1].copy()


def dead_axis(trace: Array, value: None, scene: Scene) -> Array:
    """Hold the first axis at its mean."""
    dead = trace.copy()
    dead[0] = dead[0].mean()
    return dead


def rest(
    trace: Array, seconds: float, scene: Scene, place: str = "after", snr: float = 40
) -> Array:
    """Insert rest before, after or in the middle: noise ``snr`` dB below the signal; null: none."""
    shape = len(trace), round(seconds * scene.rate)
    strength = 0.0 if snr is None else deviation(trace) * 10 ** (-snr / 20)
    quiet = trace.mean(axis=1, keepdims=True) + strength * scene.rng.standard_normal(shape)
    at = {"before": 0, "middle": trace.shape[1] // 2, "after": trace.shape[1]}[place]
    return np.concatenate((trace[:, :at], quiet, trace[:, at:]), axis=1)


def lying(trace: Array, times: float, scene: Scene, place: str = "before") -> Array:
    """Let the tool lie for 2 s at another level, and pick it up or put it down within 0.2 s."""
    level = trace.mean(axis=1, keepdims=True) + times * deviation(trace)
    noise = 0.01 * deviation(trace) * scene.rng.standard_normal((len(trace), round(2 * scene.rate)))
    ends = trace[:, :1] if place == "before" else trace[:, -1:]
    moved = level + (ends - level) * np.linspace(0, 1, max(2, round(0.2 * scene.rate)))
    if place == "before":
        return np.concatenate((level + noise, moved, trace), axis=1)
    return np.concatenate((trace, moved[:, ::-1], level + noise), axis=1)


def knock(trace: Array, times: float, scene: Scene) -> Array:
    """Add one decaying impact of so many deviations somewhere in the recording."""
    time = np.arange(trace.shape[1]) / scene.rate
    begin = scene.rng.uniform(0.2, 0.8) * time[-1]
    decay = np.where(time >= begin, np.exp(-np.maximum(time - begin, 0) / 0.01), 0.0)
    return trace + times * deviation(trace) * decay * scene.rng.standard_normal(trace.shape)


def spikes(trace: Array, times: float, scene: Scene, number: int = 5) -> Array:
    """Replace single samples by so many deviations."""
    spoilt = trace.copy()
    spoilt[:, scene.rng.integers(trace.shape[1], size=number)] += times * deviation(trace)
    return spoilt


def dropouts(trace: Array, seconds: float, scene: Scene, number: int = 5) -> Array:
    """Replace some stretches by zeros, as lost packets."""
    holed, length = trace.copy(), max(1, round(seconds * scene.rate))
    for begin in scene.rng.integers(max(1, trace.shape[1] - length), size=number):
        holed[:, begin : begin + length] = 0
    return holed


def hum(trace: Array, snr: float, scene: Scene, hertz: float = 50, harmonics: int = 1) -> Array:
    """Add mains hum ``snr`` dB below the signal, with harmonics 1 / n as strong."""
    time, phase = np.arange(trace.shape[1]) / scene.rate, scene.rng.random()
    orders = [n for n in range(1, harmonics + 1) if n * hertz < scene.rate / 2]
    waves = [np.sin(2 * np.pi * n * (hertz * time + phase)) / n for n in orders]
    tone = np.broadcast_to(np.sum(waves, axis=0), trace.shape) if waves else np.zeros(trace.shape)
    return trace + traces.scaled(tone, trace, snr)


def cut(trace: Array, seconds: float, scene: Scene) -> Array:
    """Keep so many seconds in the middle."""
    length = max(1, round(seconds * scene.rate))
    begin = max(0, (trace.shape[1] - length) // 2)
    return trace[:, begin : begin + length]


def lower_band(trace: Array, share: float, scene: Scene) -> Array:
    """Low-pass at a share of the band."""
    return traces.low_pass(trace, share * scene.rate / 2, scene)


def high_pass(trace: Array, hertz: float, scene: Scene) -> Array:
    """Take away level and slow movement, as of a sensor that is coupled by a capacitor."""
    spectrum = np.fft.rfft(trace, axis=1)
    frequency = np.fft.rfftfreq(trace.shape[1], 1 / scene.rate)
    ratio = (frequency / hertz) ** 2
    return np.fft.irfft(spectrum * ratio / (1 + ratio), trace.shape[1], axis=1)


def mount(trace: Array, share: float, scene: Scene, quality: float = 3) -> Array:
    """Let the tool resonate at a share of the band: 12 dB more there, the rest as it was."""
    top, bottom = scipy.signal.iirpeak(share, quality)
    mean = trace.mean(axis=1, keepdims=True)
    return trace + 3 * scipy.signal.lfilter(top, bottom, trace - mean, axis=1)


def swaying_force(trace: Array, depth: float, scene: Scene) -> Array:
    """Modulate the strength slowly, at 1 Hz."""
    time, mean = np.arange(trace.shape[1]) / scene.rate, trace.mean(axis=1, keepdims=True)
    wave = 1 + depth * np.sin(2 * np.pi * (time + scene.rng.random()))
    return mean + (trace - mean) * wave


def repeated(trace: Array, times: int, scene: Scene) -> Array:
    """Go over the surface so many times in one recording, to and fro."""
    return np.concatenate([trace[:, :: (-1) ** n] for n in range(times)], axis=1)


def backwards(trace: Array, value: None, scene: Scene) -> Array:
    """Reverse time."""
    return trace[:, ::-1].copy()


def quarter_turns(photo: Array, number: int, scene: Scene) -> Array:
    """Turn by so many times 90 degrees."""
    return np.rot90(photo, number).copy()


def mirrored(photo: Array, value: None, scene: Scene) -> Array:
    """Exchange left and right."""
    return photo[:, ::-1].copy()


def border(photo: Array, share: float, scene: Scene, grey: int = 255) -> Array:
    """Add an even border, a share of the shorter side wide."""
    width = round(share * min(photo.shape[:2]))
    return np.pad(photo, ((width, width), (width, width), (0, 0)), constant_values=grey)


def middle(photo: Array, share: float, scene: Scene) -> Array:
    """Keep a share of each side in the middle."""
    height, width = photo.shape[:2]
    down, across = round(height * (1 - share) / 2), round(width * (1 - share) / 2)
    return photo[down : height - down, across : width - across].copy()


def sixteen_bits(photo: Array, value: None, scene: Scene) -> Array:
    """Write grey values of 16 bits, as scientific cameras do."""
    return (
        np.rint(pixels.desaturation(photo, 1, scene)[..., 0] * 257).clip(0, 65535).astype(np.uint16)
    )


def one_channel(photo: Array, value: None, scene: Scene) -> Array:
    """Write grey values of 8 bits, without colours."""
    return np.rint(pixels.desaturation(photo, 1, scene)[..., 0]).clip(0, 255).astype(np.uint8)
