"""Traces in XML, as the Penn Haptic Texture Toolkit (HaTT) has them.

``SampleRate`` holds the rate in Hz, ``AccelX``, ``AccelY`` and ``AccelZ`` the samples; ``x``, ``y``
and ``z`` inside ``Accel`` are read as well, and so is one axis in ``Accel``. Numbers stand apart by
white space, commas or semicolons, or in elements of their own. Other elements are passed over.

The file is parsed in pieces, of which only those numbers are kept. A document type is refused, so
that no entity can expand.
"""

import re
from collections import defaultdict
from math import inf
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np
import numpy.typing as npt

from tex_lightning.data.time_column import RawTrace

RATE = "samplerate"
ACCELERATION = "accel"
AXES = ("accelx", "accely", "accelz")
SHOWN = {RATE: "SampleRate", "accelx": "AccelX", "accely": "AccelY", "accelz": "AccelZ"}


def read_xml_trace(path: Path) -> RawTrace:
    """Read acceleration and rate.

    Raises:
        ValueError: If it is no whole XML file, has a document type, or rate or samples are missing
            or no numbers.
    """
    collected = _Collector()
    parser = expat.ParserCreate()
    parser.StartElementHandler = collected.start
    parser.EndElementHandler = collected.end
    parser.CharacterDataHandler = collected.characters
    parser.StartDoctypeDeclHandler = _refuse
    try:
        with path.open("rb") as stream:
            parser.ParseFile(stream)
    except expat.ExpatError as error:
        raise ValueError(f"it is no whole XML file: {error}") from error
    numbers = {name: _numbers(name, text) for name, text in collected.text.items()}
    return RawTrace(_axes(numbers), _rate(numbers.get(RATE, np.empty(0))))


class _Collector:
    """Text of the elements that are read, by name, without their children's names."""

    def __init__(self) -> None:
        self.text: dict[str, list[str]] = defaultdict(list)
        self.names = [""]  # what the text of the open elements belongs to

    def start(self, tag: str, _: dict[str, str]) -> None:
        name = tag.rpartition(":")[2].lower()
        inside = self.names[-1]
        if inside == ACCELERATION and name in ("x", "y", "z"):
            name = f"{inside}{name}"
        known = name in (RATE, ACCELERATION, *AXES)
        self.names.append(name if known else inside)
        self.characters(" ")

    def end(self, _: str) -> None:
        self.characters(" ")
        self.names.pop()

    def characters(self, text: str) -> None:
        if self.names[-1]:
            self.text[self.names[-1]].append(text)


def _refuse(*_: object) -> NoReturn:
    raise ValueError("it has a document type (DOCTYPE), which is not read; take that line out")


def _numbers(name: str, pieces: list[str]) -> npt.NDArray[np.float64]:
    words = re.split(r"[\s,;]+", "".join(pieces).strip())
    try:
        return np.array([word for word in words if word], np.float64)
    except ValueError as error:
        raise ValueError(f"{SHOWN.get(name, name)} holds what is no number: {error}") from error


def _rate(found: npt.NDArray[np.float64]) -> float:
    if len(found) != 1:
        raise ValueError(f"it has {len(found) or 'no'} SampleRate where one number of Hz is needed")
    if not 0 < found[0] < inf:
        raise ValueError(f"its SampleRate is {found[0]:g}, which is no positive number of Hz")
    return float(found[0])


def _axes(numbers: dict[str, npt.NDArray[np.float64]]) -> npt.NDArray[np.float64]:
    """Samples (axes, samples), three axes or one."""
    axes = [numbers.get(name, np.empty(0)) for name in AXES]
    single = numbers.get(ACCELERATION, np.empty(0))
    if not any(len(axis) for axis in axes) and len(single):
        return single[None]
    missing = [SHOWN[name] for name, axis in zip(AXES, axes, strict=True) if not len(axis)]
    if missing:
        raise ValueError(f"it has no samples of {', '.join(missing)}")
    if len({len(axis) for axis in axes}) > 1:
        counts = ", ".join(str(len(axis)) for axis in axes)
        raise ValueError(f"AccelX, AccelY and AccelZ have {counts} samples, which differ")
    return np.stack(axes)
