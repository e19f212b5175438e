"""Recordings that are only a part of their file: a stretch of a signal or a strip of a photo.

A part is a pair of fractions from 0 to 1, of the length of a signal or of the width of a photo.
What lies at a border belongs to one of two neighbours alone, so that parts without overlap share
nothing.
"""

import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from tex_lightning.errors import UserError

Part = tuple[float, float]
WHOLE: Part = (0.0, 1.0)
DIGITS = 6  # of a fraction that is no user's


def equal_parts(count: int) -> list[Part]:
    """Divide a file into so many parts of equal size, in order."""
    borders = [round(number / count, DIGITS) for number in range(count + 1)]
    return list(pairwise(borders))


def write_part(part: Part) -> str:
    """The part as text, such as ``0-0.5``, exactly."""
    return "-".join(np.format_float_positional(border, trim="-") for border in part)


def read_part(text: str) -> Part:
    """The part that :func:`write_part` wrote.

    Raises:
        ValueError: If it is none.
    """
    begin, end = map(float, text.split("-"))
    if not 0 <= begin < end <= 1:
        raise ValueError("it does not rise from 0 to 1")
    return begin, end


def overlap(one: Part | None, other: Part | None) -> bool:
    """Whether two parts of one file share anything; None is all of it."""
    (begin, end), (start, stop) = one or WHOLE, other or WHOLE
    return begin < stop and start < end


def name_part(path: Path, part: Part | None) -> str:
    """The file, with its part behind ``#`` if it is one."""
    return str(path) if part is None else f"{path}#{write_part(part)}"


def split_name(name: str) -> tuple[Path, Part | None]:
    """The file and the part that :func:`name_part` joined."""
    match = re.fullmatch(r"(.+)#([\d.]+-[\d.]+)", name)
    return (Path(match[1]), read_part(match[2])) if match else (Path(name), None)


def cut_part(array: npt.NDArray[Any], part: Part | None, path: Path) -> npt.NDArray[Any]:
    """Cut the part out of a signal (axes, samples) or a photo (height, width, 3).

    Raises:
        UserError: If nothing is in it.
    """
    if part is None:
        return array
    begin, end = (round(border * array.shape[1]) for border in part)
    if begin == end:
        raise UserError(
            f"Part {write_part(part)} of {path} is empty, as the file has only {array.shape[1]} "
            "samples or columns; give a larger part."
        )
    return array[:, begin:end]
