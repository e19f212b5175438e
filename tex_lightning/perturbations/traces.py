"""Perturbations of a signal by its sensor and amplifier: (axes, samples) float32 at a known rate.

SNR in dB is 10 log10 of the power of the signal, without its mean, over that of the disturbance.
"""

import numpy as np
from scipy.signal import fftconvolve

from tex_lightning.perturbations.scene import Array, Scene, power, scaled

OCTAVES = 20  # from 1 Hz, beyond any sensor's
ROOM_SECONDS = 0.5


def white_noise(trace: Array, snr: float, scene: Scene) -> Array:
    """Independent Gaussian noise on every axis."""
    return trace + scaled(scene.rng.standard_normal(trace.shape), trace, snr)


def mains_hum(trace: Array, snr: float, scene: Scene) -> Array:
    """A tone of 50 Hz with any phase, the same on every axis."""
    time = np.arange(trace.shape[1]) / scene.rate
    tone = np.sin(2 * np.pi * (50 * time + scene.rng.random()))
    return trace + scaled(np.broadcast_to(tone, trace.shape), trace, snr)


def second_surface(trace: Array, snr: float, scene: Scene) -> Array:
    """A recording of another class, repeated to the same length."""
    other = np.resize(scene.other()[0], trace.shape[1])
    return trace + scaled(np.broadcast_to(other - other.mean(), trace.shape), trace, snr)


def quieter(trace: Array, decibel: float, scene: Scene) -> Array:
    """Amplification too low."""
    return trace * 10 ** (-decibel / 20)


def louder(trace: Array, decibel: float, scene: Scene) -> Array:
    """Amplification too high, without clipping."""
    return trace * 10 ** (decibel / 20)


def clipping(trace: Array, share: float, scene: Scene) -> Array:
    """The sensor saturates: ``share`` of the samples of every axis are cut off, mean removed."""
    mean = trace.mean(axis=1, keepdims=True)
    bound = np.quantile(np.abs(trace - mean), 1 - share, axis=1, keepdims=True)
    clipped: Array = np.clip(trace - mean, -bound, bound) + mean
    return clipped


def dropped_samples(trace: Array, share: float, scene: Scene) -> Array:
    """Single samples lost at random; the mean stands in their place."""
    lost = scene.rng.random(trace.shape[1]) < share
    thinned: Array = np.where(lost, trace.mean(axis=1, keepdims=True), trace)
    return thinned


def dropped_stretch(trace: Array, share: float, scene: Scene) -> Array:
    """One stretch of the trace lost; the mean stands in its place."""
    samples = trace.shape[1]
    length = round(share * samples)
    begin = int(scene.rng.random() * (samples - length + 1))
    holed: Array = trace.copy()
    holed[:, begin : begin + length] = trace.mean(axis=1, keepdims=True)
    return holed


def quantisation(trace: Array, bits: float, scene: Scene) -> Array:
    """Rounding to 2**bits steps over the range of the trace."""
    low, high = trace.min(), trace.max()
    step = (high - low) / (2**bits - 1)
    stepped: Array = trace if step == 0 else low + np.round((trace - low) / step) * step
    return stepped


def low_pass(trace: Array, cut_off: float, scene: Scene) -> Array:
    """A loosely fixed sensor: a second-order low pass of ``cut_off`` Hz."""
    spectrum = np.fft.rfft(trace, axis=1)
    frequency = np.fft.rfftfreq(trace.shape[1], 1 / scene.rate)
    return np.fft.irfft(spectrum / (1 + (frequency / cut_off) ** 2), trace.shape[1], axis=1)


def other_sensor(trace: Array, deviation: float, scene: Scene) -> Array:
    """Another microphone or mounting: a gain for each octave, normal with ``deviation`` dB.

    Between the octaves' centres it goes evenly over the logarithm of the frequency.
    """
    frequency = np.fft.rfftfreq(trace.shape[1], 1 / scene.rate)
    octaves = np.log2(np.maximum(frequency, 1.0))
    gains = deviation * scene.rng.standard_normal(OCTAVES)
    response = 10 ** (np.interp(octaves, np.arange(OCTAVES), gains) / 20)
    return np.fft.irfft(np.fft.rfft(trace, axis=1) * response, trace.shape[1], axis=1)


def reverberation(trace: Array, ratio: float, scene: Scene) -> Array:
    """A room that answers for half a second, its sound ``ratio`` dB below the direct one.

    What it answers is noise that decays by 60 dB in that time.
    """
    samples = int(ROOM_SECONDS * scene.rate)
    decay = 10 ** (-3 * np.arange(samples) / samples)
    answer = decay * scene.rng.standard_normal(samples)
    centred = trace - trace.mean(axis=1, keepdims=True)
    echoes = fftconvolve(centred, answer[None], axes=1)[:, : trace.shape[1]]
    return trace + scaled(echoes, trace, ratio)


def baseline_drift(trace: Array, strength: float, scene: Scene) -> Array:
    """A slow wave of 0.5 Hz, ``strength`` times the trace's root mean square."""
    time = np.arange(trace.shape[1]) / scene.rate
    wave: Array = np.sin(2 * np.pi * (0.5 * time + scene.rng.random()))
    return trace + wave * (strength * float(np.sqrt(2 * power(trace))))


def silence(trace: Array, share: float, scene: Scene) -> Array:
    """A share of the recordings is silence, as of a sensor that is unplugged."""
    return np.zeros_like(trace) if scene.rng.random() < share else trace
