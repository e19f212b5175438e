"""What the graph takes of recordings, and what is wrong with them, as ``task=predict`` has it."""

from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tex_lightning_runtime.files import Array, read_photo, read_trace, require

REACH, BETA = 10, 5.0  # of SciPy's filter: samples of the lower rate on each side; Kaiser's window
FLAT_SHARE, FINE_VALUES = 0.01, 32  # from which on a trace is clipped; fewer are coarse steps
UNIFORM, PHOTO_SIDE = 0.5, 256  # grey levels of deviation; pixels that are looked at


class Decoded(NamedTuple):
    """Input of the graph, what seeds its tuples, warnings, whether nothing was measured."""

    array: Array
    content: Array
    warnings: list[str]
    empty: bool


def decode(given: Any, sense: dict[str, Any], rate: float | None = None) -> Decoded:
    """Bring a file or array to what the graph takes for a sense of the card."""
    return _trace(given, sense, rate) if sense["medium"] == "signal" else _photo(given, sense)


def _trace(given: Any, sense: dict[str, Any], rate: float | None) -> Decoded:
    raw, rate = read_trace(given, sense, rate)
    require(len(raw) in sense["axes"], f"Give a trace of {sense['axes']} axes, not {len(raw)}.")
    trace, what, x = resample(raw, rate, sense["rate"]), sense["what"], raw.astype(np.float64)
    low, high = x.min(axis=1, keepdims=True), x.max(axis=1, keepdims=True)
    constant = (low == high)[:, 0]
    if constant.all():
        how = "constant" if high.any() else "silent"
        said = f"The {what} is {how}, so nothing was measured; check the sensor."
        return Decoded(trace, trace, [said], empty=True)
    axes = np.flatnonzero(constant) + 1
    found = [f"Axis {axis} of the {what} is constant; check the sensor." for axis in axes]
    flat = (((x == low) | (x == high))[:, 1:] & (x[:, 1:] == x[:, :-1])).sum(axis=1)
    flat[[len(np.unique(values)) < FINE_VALUES for values in x]] = 0
    if (clipped := flat.max() / x.shape[1]) >= FLAT_SHARE:
        told = f"The {what} is clipped, {clipped:.0%} of it at its largest or smallest value; "
        found.append(f"{told}lower the sensor's gain.")
    level = np.sqrt(trace.astype(np.float64).var(axis=1).sum())
    found += _unlike(sense, level=level, rate=min(rate, sense["rate"]))
    return Decoded(trace, trace, found, empty=False)


def _photo(given: Any, sense: dict[str, Any]) -> Decoded:
    photo, what, least = read_photo(given, sense["modality"]), sense["what"], sense["least"] or 1
    seen = halve(photo) if sense["half_scale"] else photo
    said = f"The {what} has {seen.shape[1]}x{seen.shape[0]} pixels after decoding"
    require(min(seen.shape[:2]) >= least, f"{said}; use one of at least {least} a side.")
    step = max(1, min(seen.shape[:2]) // PHOTO_SIDE)
    grey = seen[::step, ::step].mean(axis=2)
    found = _unlike(sense, brightness=grey.mean(), contrast=grey.std())
    if empty := bool(grey.std() < UNIFORM):
        found = [f"The {what} is uniform, so it shows nothing; check the camera."]
    return Decoded(photo, seen, found, empty)


def _unlike(sense: dict[str, Any], **measures: float) -> list[str]:
    return [
        f"The {sense['what']} has a {name} of {measures[name]:.5g} {advice}"
        for name, (low, high, advice) in sense["limits"].items()
        if not low <= measures[name] <= high
    ]


def halve(photo: Array) -> Array:
    """Rounded means of 2x2 pixels; a last row or column of an odd number is left out."""
    from PIL import Image

    box = 0, 0, photo.shape[1] // 2 * 2, photo.shape[0] // 2 * 2
    return np.asarray(Image.fromarray(photo).reduce(2, box))


def resample(x: Array, source: float, target: float) -> Array:
    """Bring signals (axes, samples) to another rate in Hz by SciPy's ``resample_poly``, float32.

    Samples are equal to the last bit, as they seed the tuples of a FusionNet.
    """
    ratio = Fraction(target / source if source > 0 else 0).limit_denominator(10_000)
    said = f"A sampling rate of {source:g} Hz is too far from {target:g} Hz; correct it."
    require(0.001 < ratio < 1000, said)
    (up, down), dtype = ratio.as_integer_ratio(), x.dtype.type
    if up == down:
        return np.ascontiguousarray(x, np.float32)
    half, cutoff = REACH * max(up, down), 1 / max(up, down)
    sinc = cutoff * np.sinc(cutoff * np.arange(-half, half + 1.0))
    low_pass = sinc * np.kaiser(2 * half + 1, BETA)
    low_pass = (low_pass / low_pass.sum()).astype(dtype) * dtype(up)
    taps = np.pad(low_pass, (0, -len(low_pass) % up)).reshape(-1, up).T
    # sample `up * row + p` is a sum over samples up to `down * row + newest[p]`
    newest, phases = np.divmod(np.arange(up) * down + half, up)
    count, lead = -(-x.shape[1] * up // down), taps.shape[1] - 1
    rows = -(-count // up)
    length = (rows + (newest[-1] + lead) // down + 1) * down
    padded = np.pad(x, ((0, 0), (lead, length)))[:, :length]
    every = sliding_window_view(
        padded.reshape(len(x), -1, down).swapaxes(1, 2).copy(), rows, axis=2
    )
    found = np.zeros((len(x), up, rows), dtype)
    for age in range(lead, -1, -1):  # SciPy's order, so that every sum is rounded as there
        late, residue = np.divmod(newest + lead - age, down)
        found += every[:, residue, late] * taps[phases, age, None]
    return found.swapaxes(1, 2).reshape(len(x), -1)[:, :count].astype(np.float32)
