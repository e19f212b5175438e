"""Recordings out of files and arrays, to what the graph takes, as ``task=predict`` has them."""

import logging
import math
import re
import warnings
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tex_lightning_runtime.archives import ARCHIVES, read_archive
from tex_lightning_runtime.columns import Reading
from tex_lightning_runtime.photos import read_photo, to_rgb
from tex_lightning_runtime.tables import SUFFIXES, read_table
from tex_lightning_runtime.times import TableError

log = logging.getLogger(__name__)
Array = np.ndarray[Any, np.dtype[Any]]
MIN_RATE, MAX_RATE = 19.0, 210_000.0  # Hz: 20 Hz to 200 kHz, by clocks that are not exact
SAME_RATE = 0.005  # by which clocks of the same rate may differ; such samples stay as they are
LARGEST = 1e9  # no unit of acceleration comes near; squares still fit float32
MAX_SAMPLES = 1 << 29  # of a signal, 2 GiB of float32
MAX_PIXELS, MAX_SIDE = 1 << 24, 1 << 12  # of a photo that is looked at, after halving
FORMATS = ("JPEG", "PNG", "BMP", "WEBP")  # whatever a name says; libtiff is left alone
REACH, BETA = 10, 5.0  # of SciPy's filter: samples of the lower rate on each side; Kaiser's window
FLAT_SHARE, MIN_FLAT, FINE_VALUES = 0.01, 10, 32  # clipped from both on; fewer are coarse steps
UNIFORM, PHOTO_SIDE = 0.5, 256  # grey levels of deviation; pixels that are looked at


class UserError(Exception):
    """Bad input: one plain sentence of what was wrong, where, and what to do."""


class Decoded(NamedTuple):
    """Input of the graph, what seeds its tuples, warnings, whether nothing was measured."""

    array: Array
    content: Array
    warnings: list[str]
    empty: bool


def require(condition: object, message: str) -> None:
    """Raise a :class:`UserError` unless the condition holds."""
    if not condition:
        raise UserError(message)


def decode(given: Any, sense: dict[str, Any], rate: float | None = None) -> Decoded:
    """Bring a file, samples (axes, samples) or pixels to what a sense of the card takes."""
    if sense["medium"] == "photo":
        return _photo(given, sense)
    return assess(*read_trace(given, sense, rate), sense)


def assess(raw: Array, rate: float, sense: dict[str, Any]) -> Decoded:
    """Bring samples (axes, samples) to what a sense of the card takes, and judge them."""
    require(len(raw) in sense["axes"], f"Give a trace of {sense['axes']} axes, not {len(raw)}.")
    trace, what, x = resample(raw, rate, sense["rate"]), sense["what"], raw.astype(np.float64)
    low, high = x.min(axis=1, keepdims=True), x.max(axis=1, keepdims=True)
    (dead,) = (low == high)[:, 0].nonzero()
    if len(dead) == len(x):
        said = f"The {what} is {'constant' if high.any() else 'silent'}, so nothing was measured; "
        return Decoded(trace, trace, [f"{said}check the sensor."], empty=True)
    found = [f"Axis {n + 1} of the {what} is constant; check the sensor." for n in dead]
    flat = (((x == low) | (x == high))[:, 1:] & (x[:, 1:] == x[:, :-1])).sum(axis=1)
    flat[[len(np.unique(values)) < FINE_VALUES for values in x]] = 0
    clipped = flat.max() / x.shape[1]
    if flat.max() >= MIN_FLAT and clipped >= FLAT_SHARE:
        told = f"The {what} is clipped, {clipped:.0%} of it at its largest or smallest value; "
        found.append(f"{told}lower the sensor's gain.")
    level = np.sqrt(trace.astype(np.float64).var(axis=1).sum())
    found += _unlike(sense, level=level, rate=min(rate, sense["rate"]))
    return Decoded(trace, trace, found, empty=False)


def _photo(given: Any, sense: dict[str, Any]) -> Decoded:
    what, least, array = sense["what"], sense["least"] or 1, _read(_read_pixels, given, sense)
    photo = np.repeat(array[..., None], 3, axis=2) if array.ndim == 2 else array
    fits = photo.dtype == np.uint8 and photo.ndim == 3 and photo.shape[2] == 3 and photo.size
    require(fits, f"The {what} is {array.dtype} {array.shape}; give uint8 (height, width, 3).")
    seen = photo = np.ascontiguousarray(_middle(photo, 2 if sense["half_scale"] else 1))
    if sense["half_scale"]:  # rounded means of 2x2 pixels, without an odd last row or column
        from PIL import Image  # where it is needed: start-up is counted in milliseconds

        box = 0, 0, photo.shape[1] // 2 * 2, photo.shape[0] // 2 * 2
        seen = np.asarray(Image.fromarray(photo).reduce(2, box))
    side, said = min(seen.shape[:2]), f"The {what} has {seen.shape[1]}x{seen.shape[0]} pixels"
    require(side >= least, f"{said} after decoding; use one of at least {least} a side.")
    step = max(1, side // PHOTO_SIDE)
    red, green, blue = np.moveaxis(seen[::step, ::step], 2, 0)
    grey = red.astype(np.uint16) + green + blue  # a mean over the last axis takes six times as long
    contrast = grey.std() / 3
    found = _unlike(sense, brightness=grey.mean() / 3, contrast=contrast)
    if empty := bool(contrast < UNIFORM):
        found = [f"The {what} is uniform, so it shows nothing; check the camera."]
    return Decoded(photo, seen, found, empty)


def _middle(photo: Array, scale: int) -> Array:
    """Cut out the middle of a photo that has more than MAX_PIXELS at 1 / scale of its size."""
    sizes = [length // scale for length in photo.shape[:2]]
    if sizes[0] * sizes[1] <= MAX_PIXELS:
        return photo
    kept = [min(size, MAX_PIXELS // min(MAX_SIDE, *sizes)) for size in sizes]
    top, left = (scale * ((size - each) // 2) for size, each in zip(sizes, kept, strict=True))
    return photo[top : top + scale * kept[0], left : left + scale * kept[1]]


def _unlike(sense: dict[str, Any], **measures: float) -> list[str]:
    return [
        f"The {sense['what']} has a {name} of {measures[name]:.5g} {advice}"
        for name, (low, high, advice) in sense["limits"].items()
        if not low <= measures[name] <= high
    ]


def resample(x: Array, source: float, target: float) -> Array:
    """Bring signals (axes, samples) to another rate in Hz; equal to SciPy's to the last bit."""
    require(MIN_RATE <= source <= MAX_RATE, f"A rate of {source:g} Hz is far from 20 to 200,000.")
    same = math.isclose(source, target, rel_tol=SAME_RATE)
    ratio = Fraction(1 if same else target / source).limit_denominator(10_000)
    count, most = int(x.size * ratio), f"the most are {MAX_SAMPLES:,}; correct the rate"
    require(count <= MAX_SAMPLES, f"At {source:g} Hz there would be {count:,} samples, {most}.")
    (up, down), dtype = ratio.as_integer_ratio(), x.dtype.type
    if up == down:
        return np.ascontiguousarray(x, np.float32)
    half, cutoff = REACH * max(up, down), 1 / max(up, down)
    sinc = cutoff * np.sinc(cutoff * np.arange(-half, half + 1.0)) * np.kaiser(2 * half + 1, BETA)
    low_pass = (sinc / sinc.sum()).astype(dtype) * dtype(up)
    taps = np.pad(low_pass, (0, -len(low_pass) % up)).reshape(-1, up).T
    # sample `up * row + p` is a sum over samples up to `down * row + newest[p]`
    newest, phases = np.divmod(np.arange(up) * down + half, up)
    count, lead = -(-x.shape[1] * up // down), taps.shape[1] - 1
    rows = -(-count // up)
    length = (rows + (newest[-1] + lead) // down + 1) * down
    padded = np.pad(x, ((0, 0), (lead, length)))[:, :length]
    columns = padded.reshape(len(x), -1, down).swapaxes(1, 2).copy()
    every, found = sliding_window_view(columns, rows, axis=2), np.zeros((len(x), up, rows), dtype)
    for age in range(lead, -1, -1):  # SciPy's order, so that every sum is rounded as there
        late, residue = np.divmod(newest + lead - age, down)
        found += every[:, residue, late] * taps[phases, age, None]
    return found.swapaxes(1, 2).reshape(len(x), -1)[:, :count].astype(np.float32)


def read_trace(
    given: Any, sense: dict[str, Any], rate: float | None, *, is_chunk: bool = False
) -> tuple[Array, float]:
    """Samples (axes, samples) and their rate in Hz: that of the file, ``rate``, or the card's.

    The longer dimension is time, unless they are a chunk of a stream.
    """
    name, own, usual, reading = f"The {sense['what']}", None, sense["rate"], None
    table = _read(partial(_read_file, sense), given, sense)
    if isinstance(table, tuple):
        (table, own, reading), name, usual = table, given, sense["file_rate"]
    trace = np.atleast_2d(table)
    trace = trace if is_chunk or len(trace) <= trace.shape[-1] else trace.T
    fits = table.dtype.kind in "fiu" and table.ndim in (1, 2) and trace.size
    require(fits, f"{name} is {table.dtype} {table.shape}; give samples (axes, samples).")
    if reading is None:  # of a table they are chosen
        trace = _chosen(trace, sense["channels"], name)
    usable = (np.abs(trace) < LARGEST).all(axis=0)  # false for NaN
    said = f"{name} holds NaN, infinity or a number beyond {LARGEST:g}"
    require(usable.all(), f"{said} at sample {usable.argmin()}; repair the recording.")
    kind = np.float32 if own and reading is None else np.float64  # as files have them
    return trace.astype(kind), own or (usual if rate is None else rate)


def _read(read: Any, given: Any, sense: dict[str, Any]) -> Any:
    """What ``read`` makes of a file, or an array as it is; what cannot be read is refused."""
    file = Path(given).expanduser() if isinstance(given, str | Path) else None
    there = not file or (file.is_file() and file.stat().st_size)
    require(there, f"File {given} does not exist or is empty; correct the name.")
    try:
        with warnings.catch_warnings(action="ignore"):  # of metadata
            if file:
                return read(file)
            return to_rgb(given.copy())[0] if hasattr(given, "getexif") else np.asarray(given)
    except TableError as error:
        raise UserError(f"{given} {error}.") from error
    except Exception as error:  # libraries raise in as many ways as there are formats
        name = given if file else f"The {sense['what']}"
        said = " ".join(str(error).split()).partition(". ")[0].rstrip(".")  # then comes advice
        raise UserError(f"{name} cannot be read ({said}); repair or replace it.") from error


def _chosen(trace: Array, channels: list[int | str] | None, name: str) -> Array:
    """Keep the axes of some numbers; without names there are just those that were asked for."""
    numbers = [each for each in channels or () if isinstance(each, int)]
    if channels is None or (len(numbers) < len(channels) == len(trace)):
        return trace
    fits = len(numbers) == len(channels) and max(numbers) < len(trace)
    require(fits, f"{name} has {len(trace)} channels; give all of them.")
    return trace[numbers]


def _read_file(sense: dict[str, Any], path: Path) -> tuple[Array, float | None, Reading | None]:
    """Samples of a file, their rate in Hz if it says it, and of tables how they were read."""
    axes, suffix = re.fullmatch(r"(.+_)[XYZ](_[^_]+)", path.name), path.suffix.lower()
    several = axes and sum(path.with_name(f"{axes[1]}{x}{axes[2]}").is_file() for x in "XYZ") > 1
    require(not several, "it is one axis of several files, make them columns of one")
    if suffix in SUFFIXES:
        return read_table(path, sense["channels"], sense.get("time_unit"))
    if suffix == ".npy":
        array = np.load(path, mmap_mode="r")  # which takes no memory for what a header claims
        require(np.size(array) <= MAX_SAMPLES, f"it has more than {MAX_SAMPLES:,} samples")
        return np.array(array), None, None
    if suffix in ARCHIVES:
        return *read_archive(path, MAX_SAMPLES), None
    from tex_lightning_runtime.sounds import read_sound

    samples, rate, notes = read_sound(path, MAX_SAMPLES)
    _tell(path, notes)
    return samples, rate, None


def _tell(path: Path, notes: list[str]) -> None:
    """Say of a file what is no fault of its content."""
    for note in notes:
        log.warning("%s: %s.", path, note)


def _read_pixels(path: Path) -> Array:
    require(path.suffix.lower() not in (".tif", ".tiff"), "it is a TIFF, save it as PNG")
    photo, notes = read_photo(path, FORMATS)
    _tell(path, notes)
    return photo
