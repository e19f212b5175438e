"""What a person sees while it records: one line in a terminal, else a JSON object per chunk."""

import math
import sys
from typing import Any, Self

from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from tex_lightning.lines import print_line
from tex_lightning.progress_line import NARROW, Cell, one_line
from tex_lightning.screen import console

NAME, BAR, LEVEL, TIME = 20, 10, 9, 11  # columns of their cells
DECADES = 2.0  # of level that the bar shows, below the largest so far


def prints_lines() -> bool:
    """Whether standard output gets JSON objects: unless a person looks at a terminal alone."""
    return not (console.is_terminal and sys.stdout.isatty())


class Meter:
    """Level, time and label, as a ``with`` block; the line is gone after it.

    Standard error gets the line if it is a terminal.

    Args:
        seconds: Seconds of a whole recording.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds, self.largest = seconds, 0.0
        self._live = Live(console=console, transient=True, auto_refresh=False)

    def __enter__(self) -> Self:
        if console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._live.stop()

    def show(self, name: str | None, time: float, level: float, found: dict[str, Any]) -> None:
        """Show one chunk.

        Args:
            name: Name of the recording; None while it waits for contact.
            time: Recorded so far, in seconds.
            level: Level of the chunk, in the unit of the signal.
            found: ``label`` and ``probability``, and what else there is; empty without a network.
        """
        self.largest = max(self.largest, level)
        if prints_lines():
            print_line({"recording": name, "time": time, "level": float(f"{level:.4g}"), **found})
        if console.is_terminal:
            self._live.update(self._line(name, time, level, found), refresh=True)

    def _line(self, name: str | None, time: float, level: float, found: dict[str, Any]) -> Table:
        label, probability = found.get("label"), found.get("probability")
        said = f"{probability:.2f} {label}" if label is not None else ""
        cells: list[Cell] = [
            (LEVEL, f"{level:.3g}"),
            (TIME, f"{time:.1f}/{self.seconds:g} s" if name else "no contact"),
        ]
        if console.width >= NARROW:
            bar = ProgressBar(total=1.0, completed=self._share(level), width=BAR)
            cells = [(NAME, name or "waiting for contact"), (BAR, bar), *cells]
        return one_line(cells, lambda _: said, console.width)

    def _share(self, level: float) -> float:
        """Of the bar: logarithmic, full at the largest level so far."""
        if level <= 0 or self.largest <= 0:
            return 0.0
        return max(0.0, 1 + math.log10(level / self.largest) / DECADES)
