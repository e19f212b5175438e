"""Bytes of a sensor to samples, strictly: what cannot be meant is refused with its place."""

import re
from abc import ABC, abstractmethod
from typing import Any

import numpy as np
import numpy.typing as npt

from tex_lightning.data.decode import LARGEST, usable_samples
from tex_lightning.errors import UserError, shorten

Chunk = npt.NDArray[np.float32]  # (axes, samples)

SAMPLE = np.dtype("<f4")
LONGEST_LINE = 1000  # bytes; what goes on without a line's end is no text
NUMBERS = set(b"0123456789+-.,;eE# \t\r\n")


class Parser(ABC):
    """Turns pieces of bytes, cut anywhere, into samples.

    Args:
        name: The source as it was given, for messages.
        key: Section of its settings, such as ``record.haptic``.
        axes: Numbers of one sample.
    """

    def __init__(self, name: str, key: str, axes: int) -> None:
        self.name, self.key, self.axes = name, key, axes
        self.rest = b""  # of a sample that is not whole yet
        self.count = 0  # samples so far

    @abstractmethod
    def _take(self, content: bytes) -> npt.NDArray[Any]:
        """Samples (samples, axes) of whole ones in ``content``; keeps the rest."""

    @abstractmethod
    def _expected(self) -> str:
        """What the sensor should send."""

    def feed(self, content: bytes) -> Chunk:
        """Samples (axes, samples) that are whole now, perhaps none.

        Raises:
            UserError: If they are not of the format, or hold NaN or infinity.
        """
        samples = self._take(self.rest + content).T
        if not (usable := usable_samples(samples)).all():
            place = self.count + int(usable.argmin())
            raise UserError(
                f"{self.name} sends NaN, infinity or a number beyond {LARGEST:g} at sample "
                f"{place}; {self._expected()}."
            )
        self.count += samples.shape[1]
        return np.ascontiguousarray(samples, dtype=np.float32)

    def end(self) -> None:
        """Refuse an end within a sample.

        Raises:
            UserError: If there was one.
        """
        if self.rest.strip():
            raise UserError(f"{self.name} ends within a sample; {self._expected()}.")


class Float32Parser(Parser):
    """Little-endian float32, the axes of a sample one after another, as of ``task=stream``."""

    def _expected(self) -> str:
        return f"send {self.axes} little-endian float32 for each ({self.key}.axes)"

    def _take(self, content: bytes) -> npt.NDArray[Any]:
        if not self.count and len(content) >= SAMPLE.itemsize and NUMBERS.issuperset(content):
            raise UserError(
                f"{self.name} sends text, {shorten(content[:20])}; set {self.key}.format=text."
            )
        size = self.axes * SAMPLE.itemsize
        whole = len(content) - len(content) % size
        self.rest = content[whole:]
        return np.frombuffer(content[:whole], SAMPLE).reshape(-1, self.axes)


class TextParser(Parser):
    """A sample a line, numbers apart by comma, semicolon or white space; # begins a remark.

    Args:
        name: As of the base class.
        key: Likewise.
        axes: Likewise.
        cut: Whether the first line may have begun before we listened, and is passed over.
    """

    def __init__(self, name: str, key: str, axes: int, *, cut: bool = False) -> None:
        super().__init__(name, key, axes)
        self.lines, self.cut = 0, cut

    def _expected(self) -> str:
        return f"print a line with {self.axes} numbers for each ({self.key}.axes)"

    def _take(self, content: bytes) -> npt.NDArray[Any]:
        *lines, self.rest = content.split(b"\n")
        if len(self.rest) > LONGEST_LINE:
            raise UserError(f"{self.name} sends no lines of text; set {self.key}.format=float32.")
        samples = [row for line in lines if (row := self._row(line))]
        return np.array(samples, np.float64).reshape(-1, self.axes)

    def end(self) -> None:
        """As the base class; the last line may lack its end."""
        self.rest = b""

    def _row(self, line: bytes) -> list[float] | None:
        self.lines += 1
        text = line.decode("ascii", "replace").strip().rstrip(",;")
        if (self.cut and self.lines == 1) or not text or text.startswith("#"):
            return None
        try:
            row = [float(field) for field in re.split(r"\s*[,;\s]\s*", text)]
        except ValueError as error:
            raise UserError(
                f"{self.name}, line {self.lines}: {shorten(repr(text))} is no number; "
                f"{self._expected()}, remarks behind #."
            ) from error
        if len(row) != self.axes:
            raise UserError(
                f"{self.name}, line {self.lines}: {shorten(repr(text))} has {len(row)} numbers; "
                f"{self._expected()}."
            )
        return row
