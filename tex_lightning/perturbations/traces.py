"""Perturbations of a signal by sensor, amplifier, hand, tool and clock.

Signals are (axes, samples) float32 at a known rate. SNR in dB is 10 log10 of the power of the
signal, without its mean, over that of the disturbance.
"""

from fractions import Fraction

import numpy as np
import scipy  # whose parts are loaded when they are used

from tex_lightning.perturbations.pixels import Array, Function, Scene


def power(trace: Array) -> float:
    """Return the mean square of a trace (axes, samples) about the mean of each axis."""
    return float(np.var(trace, axis=1, dtype=np.float64).mean())


def scaled(disturbance: Array, trace: Array, snr: float) -> Array:
    """Scale a disturbance to ``snr`` dB below the power of a trace; silence stays as it is."""
    strength = power(disturbance)
    factor = np.sqrt(power(trace) / strength / 10 ** (snr / 10)) if strength > 0 else 0.0
    result: Array = disturbance * factor
    return result


def white_noise(trace: Array, snr: float, scene: Scene) -> Array:
    """Add independent Gaussian noise to every axis."""
    return trace + scaled(scene.rng.standard_normal(trace.shape), trace, snr)


def mains_hum(trace: Array, snr: float, scene: Scene) -> Array:
    """Add a tone of 50 Hz with any phase, the same to every axis."""
    time = np.arange(trace.shape[1]) / scene.rate
    tone = np.sin(2 * np.pi * (50 * time + scene.rng.random()))
    return trace + scaled(np.broadcast_to(tone, trace.shape), trace, snr)


def quieter(trace: Array, decibel: float, scene: Scene) -> Array:
    """Amplify too little."""
    return trace * 10 ** (-decibel / 20)


def louder(trace: Array, decibel: float, scene: Scene) -> Array:
    """Amplify too much, without clipping."""
    return trace * 10 ** (decibel / 20)


def clipping(trace: Array, share: float, scene: Scene) -> Array:
    """Cut off ``share`` of the samples of every axis about its mean: the sensor saturates."""
    mean = trace.mean(axis=1, keepdims=True)
    bound = np.quantile(np.abs(trace - mean), 1 - share, axis=1, keepdims=True)
    clipped: Array = np.clip(trace - mean, -bound, bound) + mean
    return clipped


def dropped_stretch(trace: Array, share: float, scene: Scene) -> Array:
    """Replace one stretch of the trace by the mean."""
    samples = trace.shape[1]
    length = round(share * samples)
    begin = int(scene.rng.random() * (samples - length + 1))
    holed: Array = trace.copy()
    holed[:, begin : begin + length] = trace.mean(axis=1, keepdims=True)
    return holed


def quantisation(trace: Array, bits: float, scene: Scene) -> Array:
    """Round to 2**bits steps over the range of the trace."""
    low, high = trace.min(), trace.max()
    step = (high - low) / (2**bits - 1)
    stepped: Array = trace if step == 0 else low + np.round((trace - low) / step) * step
    return stepped


def low_pass(trace: Array, cut_off: float, scene: Scene) -> Array:
    """Apply a second-order low pass of ``cut_off`` Hz, as of a loosely fixed sensor."""
    spectrum = np.fft.rfft(trace, axis=1)
    frequency = np.fft.rfftfreq(trace.shape[1], 1 / scene.rate)
    return np.fft.irfft(spectrum / (1 + (frequency / cut_off) ** 2), trace.shape[1], axis=1)


def silence(trace: Array, share: float, scene: Scene) -> Array:
    """Silence a share of the recordings, like an unplugged sensor."""
    return np.zeros_like(trace) if scene.rng.random() < share else trace


FINEST = 200  # largest denominator of a ratio of rates
TILT_FREQUENCY = 200.0  # Hz, where a change of force changes the level by its nominal gain
BURST_SECONDS, BURST_DECAY = 0.05, 0.008  # of an impact


def wrong_rate(trace: Array, percent: float, scene: Scene) -> Array:
    """Stretch the trace, as of a clock that ran ``percent`` faster than the stated rate."""
    return _resampled(trace, 1 + percent / 100)


def stroke_velocity(trace: Array, factor: float, scene: Scene) -> Array:
    """Imitate a faster stroke by resampling: higher, shorter and louder by the same factor.

    A real one also changes how the tool follows the relief, which no recording can tell.
    """
    return factor * _resampled(trace, 1 / factor)


def force(trace: Array, decibel: float, scene: Scene) -> Array:
    """Imitate a heavier hand: louder by ``decibel``, half as many dB per decade darker.

    A stand-in: the contact changes with force in ways that no recording can tell.
    """
    frequency = np.fft.rfftfreq(trace.shape[1], 1 / scene.rate)
    decades = np.log10(np.maximum(frequency, 1.0) / TILT_FREQUENCY)
    gain = 10 ** ((decibel - decibel / 2 * decades) / 20)
    gain[0] = 1  # gravity is no vibration
    return np.fft.irfft(np.fft.rfft(trace, axis=1) * gain, trace.shape[1], axis=1)


def impact_left_in(trace: Array, strength: float, scene: Scene) -> Array:
    """Insert a decaying burst before the movement, its peak ``strength`` times the RMS.

    It comes without the quiet by which a touch is recognised, as if a recording began with it.
    """
    time = np.arange(int(BURST_SECONDS * scene.rate)) / scene.rate
    burst = np.exp(-time / BURST_DECAY) * scene.rng.standard_normal(len(time))
    burst *= strength * np.sqrt(power(trace)) / np.abs(burst).max()
    return np.concatenate([trace.mean(axis=1, keepdims=True) + burst, trace], axis=1)


def shorter_trace(trace: Array, seconds: float, scene: Scene) -> Array:
    """Cut ``seconds`` out of the recording; more than it has leave it whole."""
    samples = min(trace.shape[1], max(1, round(seconds * scene.rate)))
    begin = int(scene.rng.random() * (trace.shape[1] - samples + 1))
    return trace[:, begin : begin + samples]


def frequency_response(trace: Array, decibel: float, scene: Scene) -> Array:
    """Amplify every octave by other decibels, of this deviation: another sensor, mount or tool."""
    octaves = np.log2(np.arange(1, max(2, trace.shape[1] // 2 + 1)))
    knots = np.arange(octaves[-1] // 1 + 2)
    decibels = np.interp(octaves, knots, scene.rng.normal(0, decibel, len(knots)))
    spectrum = np.fft.rfft(trace, axis=1)
    spectrum[:, 1:] *= 10 ** (decibels[: spectrum.shape[1] - 1] / 20)  # gravity is no vibration
    return np.fft.irfft(spectrum, trace.shape[1], axis=1)


def hum_with_harmonics(trace: Array, snr: float, scene: Scene) -> Array:
    """Add a tone of 40 to 70 Hz and its next five harmonics, of any strengths, to every axis."""
    tone, time = scene.rng.uniform(40, 70), np.arange(trace.shape[1]) / scene.rate
    orders = [order for order in range(1, 7) if order * tone < scene.rate / 2]
    if not orders:
        return trace
    waves = [np.sin(2 * np.pi * (order * tone * time + scene.rng.random())) for order in orders]
    wave = scene.rng.random(len(orders)) @ np.stack(waves)
    return trace + scaled(np.broadcast_to(wave, trace.shape), trace, snr)


DISTURBANCES: tuple[tuple[Function, float, float], ...] = (
    (white_noise, 10, 35),  # dB
    (wrong_rate, -12, 12),  # per cent
    (frequency_response, 6, 6),  # dB
    (hum_with_harmonics, 10, 25),  # dB
)


def disturbed(trace: Array, kind: int, scene: Scene) -> Array:
    """Change a signal as sensors, clocks and hands differ, which changes no material.

    Args:
        trace: (axes, samples) float32.
        kind: Number of the disturbance, counted on beyond the last; its strength is drawn.
        scene: Circumstances of the recording.
    """
    function, least, most = DISTURBANCES[kind % len(DISTURBANCES)]
    changed = function(trace, scene.rng.uniform(least, most), scene)
    return np.ascontiguousarray(changed, dtype=np.float32)


def _resampled(trace: Array, longer: float) -> Array:
    ratio = Fraction(longer).limit_denominator(FINEST)
    mean = trace.mean(axis=1, keepdims=True)  # a step at the ends would ring
    longest = scipy.signal.resample_poly(trace - mean, ratio.numerator, ratio.denominator, axis=1)
    result: Array = longest + mean
    return result
