"""Recordings out of files and arrays, to what the graph takes, as ``task=predict`` has them."""

import logging
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from tex_lightning_runtime.errors import require
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.photos import read_photo
from tex_lightning_runtime.pixels import as_pixels, halve, middle
from tex_lightning_runtime.quality import (
    Quality,
    level,
    photo_quality,
    trace_measures,
    trace_quality,
)
from tex_lightning_runtime.resampling import to_rate
from tex_lightning_runtime.samples import Array, as_trace, check_samples
from tex_lightning_runtime.traces import read_samples

log = logging.getLogger(__name__)
REMEDY = "the rate where the file has none; a column of time in milliseconds is called time_ms"


class Decoded(NamedTuple):
    """Input of the graph, what seeds its tuples, and its faults."""

    array: Array
    content: Array
    quality: Quality


class Raw(NamedTuple):
    """Samples (axes, samples) as they came, their rate in Hz, and what messages call them."""

    samples: Array
    rate: float
    name: str


def decode(given: Any, sense: dict[str, Any], rate: float | None = None) -> Decoded:
    """Bring a file, samples (axes, samples) or pixels to what a sense of the card takes."""
    if sense["medium"] == "photo":
        return _photo(given, sense)
    return assess(read_trace(given, sense, rate), sense)


def read_trace(
    given: Any, sense: dict[str, Any], rate: float | None, *, is_chunk: bool = False
) -> Raw:
    """Read samples, whose rate is that of the file, ``rate``, or the card's.

    The longer dimension is time, unless they are a chunk of a stream.
    """
    if not isinstance(given, str | Path):
        name = f"The {sense['what']}"
        samples = as_trace(given, name, sense["channels"], is_chunk=is_chunk)
        return Raw(samples, sense["rate"] if rate is None else rate, name)
    path, usual = expanded(given), sense["file_rate"] if rate is None else rate
    samples, own, reading = read_samples(path, sense["channels"], sense.get("time_unit"))
    check_samples(samples, name := f"Trace {path}")
    _tell(path, reading.notes)
    return Raw(samples, usual if own is None else own, name)


def assess(raw: Raw, sense: dict[str, Any]) -> Decoded:
    """Resample a signal to what a sense of the card takes, and judge it."""
    axes, target = len(raw.samples), sense["rate"]
    require(axes in sense["axes"], f"Give a trace of {sense['axes']} axes, not {axes}.")
    trace = to_rate(raw.samples, raw.rate, target, raw.name, REMEDY)
    measures = trace_measures(level(trace), raw.rate, target)
    quality = trace_quality(raw.samples, sense["limits"], sense["what"], measures)
    return Decoded(trace, trace, quality)


def _photo(given: Any, sense: dict[str, Any]) -> Decoded:
    what, name, least = sense["what"], f"The {sense['what']}", sense["least"] or 1
    if isinstance(given, str | Path):
        path = expanded(given)
        name = f"Image {path}"
        photo, notes = read_photo(path)
        _tell(path, notes)
    else:
        photo = as_pixels(given, name)
    photo = middle(photo, 2 if sense["half_scale"] else 1, name)
    seen = halve(photo) if sense["half_scale"] else photo
    side, said = min(seen.shape[:2]), f"The {what} has {seen.shape[1]}x{seen.shape[0]} pixels"
    require(side >= least, f"{said} after decoding; use one of at least {least} a side.")
    return Decoded(photo, seen, photo_quality(seen, sense["limits"], what))


def _tell(path: Path, notes: Iterable[str]) -> None:
    """Say of a file what is no fault of its content."""
    for note in notes:
        log.warning("%s: %s.", path, note)
