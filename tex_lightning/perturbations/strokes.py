"""Perturbations of a trace by hand, tool and clock: (axes, samples) float32 at a known rate."""

from fractions import Fraction

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.signal import resample_poly
from scipy.spatial.transform import Rotation

from tex_lightning.perturbations.scene import Array, Scene, power

FINEST = 200  # largest denominator of a ratio of rates
TILT_FREQUENCY = 200.0  # Hz, where a change of force changes the level by its nominal gain
BURST_SECONDS, BURST_DECAY = 0.05, 0.008  # of an impact


def wrong_rate(trace: Array, percent: float, scene: Scene) -> Array:
    """The clock ran ``percent`` faster than the stated rate: everything is lower, and longer."""
    return _resampled(trace, 1 + percent / 100)


def stroke_velocity(trace: Array, factor: float, scene: Scene) -> Array:
    """A faster stroke, by resampling: higher, shorter and louder by the same factor.

    A real one also changes how the tool follows the relief, which no recording can tell.
    """
    return factor * _resampled(trace, 1 / factor)


def drifting_rate(trace: Array, percent: float, scene: Scene) -> Array:
    """The speed grows steadily from true to ``percent`` above it."""
    samples = trace.shape[1]
    speed = np.linspace(1, 1 + percent / 100, samples)
    places = np.cumsum(speed) - speed[0]
    places = places[places <= samples - 1]
    return np.stack([map_coordinates(axis, places[None], order=3) for axis in trace])


def force(trace: Array, decibel: float, scene: Scene) -> Array:
    """A heavier hand: louder by ``decibel``, and half as many dB per decade darker.

    A stand-in: the contact changes with force in ways that no recording can tell.
    """
    frequency = np.fft.rfftfreq(trace.shape[1], 1 / scene.rate)
    decades = np.log10(np.maximum(frequency, 1.0) / TILT_FREQUENCY)
    gain = 10 ** ((decibel - decibel / 2 * decades) / 20)
    gain[0] = 1  # gravity is no vibration
    return np.fft.irfft(np.fft.rfft(trace, axis=1) * gain, trace.shape[1], axis=1)


def rotated_axes(trace: Array, degrees: float, scene: Scene) -> Array:
    """The sensor is turned about any axis; three axes only."""
    direction = scene.rng.standard_normal(3)
    turn = np.deg2rad(degrees) * direction / np.linalg.norm(direction)
    turned: Array = Rotation.from_rotvec(turn).as_matrix() @ trace
    return turned


def swapped_axes(trace: Array, share: float, scene: Scene) -> Array:
    """In a share of the recordings the axes change places; three axes only."""
    return np.roll(trace, 1, axis=0) if scene.rng.random() < share else trace


def dead_axis(trace: Array, share: float, scene: Scene) -> Array:
    """One axis loses a share of its amplitude about its mean; at 1 it is dead. Three axes only."""
    weak = trace.copy()
    axis = weak[scene.rng.integers(3)]
    axis -= share * (axis - axis.mean())
    return weak


def impact_left_in(trace: Array, strength: float, scene: Scene) -> Array:
    """A decaying burst before the movement, its peak ``strength`` times the root mean square.

    It comes without the quiet by which a touch is recognised, as if a recording began with it.
    """
    time = np.arange(int(BURST_SECONDS * scene.rate)) / scene.rate
    burst = np.exp(-time / BURST_DECAY) * scene.rng.standard_normal(len(time))
    burst *= strength * np.sqrt(power(trace)) / np.abs(burst).max()
    return np.concatenate([trace.mean(axis=1, keepdims=True) + burst, trace], axis=1)


def shorter_trace(trace: Array, seconds: float, scene: Scene) -> Array:
    """A stroke of ``seconds`` out of the recording; longer ones than it has leave it whole."""
    samples = min(trace.shape[1], max(1, round(seconds * scene.rate)))
    begin = int(scene.rng.random() * (trace.shape[1] - samples + 1))
    return trace[:, begin : begin + samples]


def _resampled(trace: Array, longer: float) -> Array:
    ratio = Fraction(longer).limit_denominator(FINEST)
    mean = trace.mean(axis=1, keepdims=True)  # a step at the ends would ring
    longest = resample_poly(trace - mean, ratio.numerator, ratio.denominator, axis=1)
    result: Array = longest + mean
    return result
