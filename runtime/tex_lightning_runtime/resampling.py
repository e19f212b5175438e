"""Signals as networks take them: without spikes, and at their rate.

Signals come to another rate by a low-pass filter in polyphase form.
"""

import math
from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tex_lightning_runtime.errors import UserError
from tex_lightning_runtime.samples import MAX_SAMPLES, Array

MIN_RATE, MAX_RATE = 19.0, 210_000.0  # Hz: 20 Hz to 200 kHz, by clocks that are not exact
SAME_RATE = 0.005  # by which clocks of the same rate may differ; such samples stay as they are
REACH, BETA = 10, 5.0  # as in SciPy's: samples of the lower rate on each side; Kaiser's window
IN_CACHE = 1 << 17  # samples that are summed together, which the processor keeps at hand
# A spike is one sample or two. It lies outside of the range of the samples 2 to 8 before and after
# it, by more than three times that range.
NEXT, AROUND, OUTSIDE = 2, 8, 3.0
FEW, RECENT_SECONDS = 5, 4  # more in so short a time are impacts, as of ridges under a slow sensor
BESSEL = (  # Chebyshev coefficients of exp(-x) I0(x) in [0, 8], as in Cephes
    -4.4153416464793395e-18, 3.3307945188222384e-17, -2.431279846547955e-16, 1.715391285555133e-15,
    -1.1685332877993451e-14, 7.676185498604936e-14, -4.856446783111929e-13, 2.95505266312964e-12,
    -1.726826291441556e-11, 9.675809035373237e-11, -5.189795601635263e-10, 2.6598237246823866e-09,
    -1.300025009986248e-08, 6.046995022541919e-08, -2.670793853940612e-07, 1.1173875391201037e-06,
    -4.4167383584587505e-06, 1.6448448070728896e-05, -5.754195010082104e-05, 0.00018850288509584165,
    -0.0005763755745385824, 0.0016394756169413357, -0.004324309995050576, 0.010546460394594998,
    -0.02373741480589947, 0.04930528423967071, -0.09490109704804764, 0.17162090152220877,
    -0.3046826723431984, 0.6767952744094761,
)  # fmt: skip
KEYS = (  # what a rate that is none can be mended by, on the command line of tex_lightning
    "data.file_rate where it is assumed; a column of time that is not in seconds is called "
    "time_ms, or has its data.time_unit"
)


def to_rate(trace: Array, source: float, target: float, name: str, remedy: str = KEYS) -> Array:
    """Take spikes out of (axes, samples), and resample from the rate ``source`` to ``target`` Hz.

    Returns:
        float32 array of shape (axes, samples): :func:`resample_poly` of :func:`without_spikes`.

    Raises:
        UserError: If the rates are too far apart, beginning with ``name``; see :func:`rate_ratio`.
    """
    ratio = rate_ratio(source, target, name, remedy)
    if (count := trace.size * ratio) > MAX_SAMPLES:
        raise UserError(
            f"{name} has a sampling rate of {source:g} Hz, so that it would become "
            f"{float(count):g} samples at {target:g} Hz; correct that rate, or divide the file."
        )
    return resampled(without_spikes(trace, source, find_spikes(trace)), ratio)


def resampled(trace: Array, ratio: Fraction) -> Array:
    """Return (axes, samples) float32 at ``ratio`` times their rate."""
    if ratio != 1:
        trace = resample_poly(trace, *ratio.as_integer_ratio())
    return np.ascontiguousarray(trace, dtype=np.float32)


def without_spikes(trace: Array, rate: float, spikes: Array) -> Array:
    """Return a signal (axes, samples) whose spikes are means of the samples around them.

    Faults of a cable, a converter or a transmission change every band of every frame that they are
    in. More than five of an axis within 4 s are none, but impacts, which are as short at a low
    rate; those after the fifth stay.

    Args:
        trace: The samples.
        rate: Their rate in Hz.
        spikes: What :func:`find_spikes` finds in them, and in what was before them.
    """
    if not len(spikes):
        return trace
    axes, places = spikes[np.lexsort(spikes.T[::-1])].T
    late = np.flatnonzero(axes[FEW:] == axes[:-FEW]) + FEW
    late = late[places[late] - places[late - FEW] <= RECENT_SECONDS * rate]
    mended = np.delete(np.arange(len(places)), late)
    axes, places = (each[mended[places[mended] >= 0]] for each in (axes, places))
    if len(places):
        before, after = trace[axes, places - NEXT], trace[axes, places + NEXT]
        trace = trace.copy()
        trace[axes, places] = (before + after) / 2
    return trace


def find_spikes(trace: Array) -> Array:
    """Return axis and place (spikes, 2) of samples far outside of those around them.

    A sensor with a filter before its converter measures nothing as short. Where all samples around
    one are equal, it counts as measured: coarse converters give the like.
    """
    found = [np.zeros((0, 2), np.int64)]
    for begin in range(0, trace.shape[1] - 2 * AROUND, IN_CACHE):
        part = trace[:, begin : begin + IN_CACHE + 2 * AROUND]
        inner = part[:, AROUND:-AROUND]
        highest, lowest = (_of_side(part, best) for best in (np.maximum, np.minimum))
        spread = highest - lowest
        outside = np.maximum(inner - highest, lowest - inner)
        axes, places = np.nonzero((outside > OUTSIDE * spread) & (spread > 0))
        found.append(np.stack((axes, begin + AROUND + places), axis=1))
    return np.concatenate(found)


def _of_side(part: Array, best: np.ufunc) -> Array:
    """Return the largest or smallest of the samples on both sides of each but the outer ones."""
    side = part
    for length in (1, 2, AROUND - NEXT - 3):  # of two, four, and all of one side
        side = best(side[:, :-length], side[:, length:])
    count = part.shape[1] - 2 * AROUND
    found: Array = best(side[:, :count], side[:, AROUND + NEXT :])
    return found


def rate_ratio(source: float, target: float, name: str, remedy: str = KEYS) -> Fraction:
    """Return the ratio of the number of samples at ``target`` Hz to that at ``source`` Hz.

    It is 1 for rates that differ by less than half a percent, as those that a sensor's clock gives
    from one recording to the next.

    Args:
        source: Rate of a signal.
        target: Rate that it is brought to.
        name: Name of the signal, which messages begin with.
        remedy: What to correct a wrong rate by, for messages.

    Raises:
        UserError: If ``source`` is no rate of a signal.
    """
    try:
        is_rate = MIN_RATE <= source <= MAX_RATE
    except TypeError as error:  # of what is given in Python
        raise UserError(f"{name} has a rate of {source!r}; give a number in Hz.") from error
    if not is_rate:
        raise UserError(
            f"{name} has a sampling rate of {source:g} Hz, too far from {target:g} Hz: rates are "
            f"20 Hz to 200 kHz; correct it ({remedy})."
        )
    same = math.isclose(source, target, rel_tol=SAME_RATE)
    return Fraction(1 if same else target / source).limit_denominator(10_000)


def resample_poly(x: Array, up: int, down: int) -> Array:
    """Resample (axes, samples) by the factor ``up / down``, in lowest terms and not 1.

    A level, as of gravity or of a converter's middle, stays as it is: the signal goes on with its
    first and last value, where zeros would be steps, and no new sample weighs those around it by
    more or less than 1 altogether, which would be a tone.

    Args:
        x: float32 or float64, and so is what is returned; at least one sample.
        up: Factor by which samples become more.
        down: Factor by which they then become fewer.

    Returns:
        What SciPy's function of this name returns for :func:`low_pass` and ``padtype="edge"``, to
        the last bit.
    """
    dtype, half = x.dtype.type, REACH * max(up, down)
    scaled = low_pass(up, down).astype(dtype) * dtype(up)
    taps = np.pad(scaled, (0, -len(scaled) % up)).reshape(-1, up).T
    # sample `up * row + p` is a sum over samples up to `down * row + newest[p]`
    newest, phases = np.divmod(np.arange(up) * down + half, up)
    count, lead = -(-x.shape[1] * up // down), taps.shape[1] - 1
    rows = -(-count // up)
    length = (rows + (newest[-1] + lead) // down + 1) * down
    columns = _padded(x, lead, length).reshape(len(x), -1, down).swapaxes(1, 2).copy()
    every, found = sliding_window_view(columns, rows, axis=2), np.zeros((len(x), up, rows), dtype)
    step = max(1, IN_CACHE // (len(x) * rows))
    for some in (slice(begin, begin + step) for begin in range(0, up, step)):
        part, weights = found[:, some], taps[phases[some]]
        for age in range(lead, -1, -1):  # SciPy's order, so that every sum is rounded as there
            late, residue = np.divmod(newest[some] + lead - age, down)
            product = every[:, residue, late]  # a copy
            product *= weights[:, age, None]
            part += product
    return found.swapaxes(1, 2).reshape(len(x), -1)[:, :count]


def _padded(x: Array, lead: int, length: int) -> Array:
    """Return ``length`` samples, ``lead`` before the first of ``x``; both ends go on."""
    kept = x[:, : length - lead]
    return np.pad(kept, ((0, 0), (lead, length - lead - kept.shape[1])), mode="edge")


@lru_cache(maxsize=8)
def low_pass(up: int, down: int) -> Array:
    """Return the filter that resamples by ``up / down``, float64, odd in length.

    Every ``up``-th weight belongs to the same new sample; each such part sums to ``1 / up``.
    """
    factor = max(up, down)
    half, cutoff = REACH * factor, 1 / factor
    place = np.arange(-half, half + 1.0)
    edge = np.array([BETA])
    window = _bessel(BETA * np.sqrt(1 - (place / half) ** 2.0)) / _bessel(edge)
    sinc = np.sinc(cutoff * place) * window
    parts = np.pad(sinc, (0, -len(sinc) % up)).reshape(-1, up)
    return np.asarray((parts / (up * parts.sum(axis=0))).ravel()[: len(sinc)])


def _bessel(x: Array) -> Array:
    """Return the modified Bessel function of order 0 for values in [0, 8].

    The exponential is the C library's, as SciPy's; NumPy's own may differ in the last bit.
    """
    newest, older, oldest = np.full_like(x, BESSEL[0]), np.zeros_like(x), np.zeros_like(x)
    for coefficient in BESSEL[1:]:
        oldest, older = older, newest
        newest = (x / 2 - 2) * older - oldest + coefficient
    return np.array([math.exp(each) for each in x]) * (0.5 * (newest - oldest))
