"""Progress: Rich's bars on a terminal, a line in a notebook, a line a minute elsewhere.

Work is nested: folds have networks, networks epochs. Each level has a bar below the outer one.
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager
from typing import Any, ClassVar, Self, TypeVar

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from tex_lightning.core.console import QUIET, Screen, console, is_interactive
from tex_lightning.text import printable

Item = TypeVar("Item")
BAR = 16  # columns
TOLD = 60.0  # seconds between two lines where nothing can be redrawn
SHOWN = 0.2  # seconds between two texts of a notebook's line
DAY = 24 * 3600.0  # seconds that a pace is taken from, at most
log = logging.getLogger(__name__)


class Stage:
    """A level of the work, inside those that have not ended; a ``with`` block ends it.

    Args:
        title: Unit that is counted, such as ``fold``, or the name of the current one.
        total: Total number; None if unknown.
        done: Number that an earlier run has finished.
    """

    levels: ClassVar[list["Stage"]] = []
    bars: ClassVar[Progress] = Progress(disable=True)
    told: ClassVar[float] = 0.0

    def __init__(self, title: str, total: int | None, done: float = 0) -> None:
        if not Stage.levels:
            Stage.bars, Stage.told = _bars(), time.monotonic()
            Stage.bars.start()
        self.title, self.total, self.note = title, total, ""
        self._task = Stage.bars.add_task("", total=total, completed=done)  # type: ignore[arg-type]
        Stage.levels.append(self)
        self._show(done)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def update(self, done: float, *, title: str | None = None, notes: Sequence[str] = ()) -> None:
        """Show how many are done, and notes beside that."""
        self.title = title or self.title
        self.note = ", ".join(notes) or self.note
        self._show(done)
        levels = "; ".join(level.label for level in Stage.levels)
        due = time.monotonic() - Stage.told >= TOLD and Screen.verbose > QUIET
        if NotebookLine.is_possible():
            NotebookLine.show(levels)
        elif due and Stage.bars.disable:
            Stage.told = time.monotonic()
            log.info("In progress: %s.", levels)

    def _show(self, done: float) -> None:
        counted = self.total is not None and self.total > 1
        count = f" {min(int(done) + 1, self.total or 0)}/{self.total}" if counted else ""
        self.label = printable(f"{self.title}{count}{self.note and f', {self.note}'}")
        if self._task in Stage.bars.task_ids:  # else another thread has ended all levels
            Stage.bars.update(self._task, completed=done, description=self.label)

    def end(self) -> None:
        """Remove this level and the levels inside it."""
        if self in Stage.levels:
            _cut(Stage.levels.index(self))


class NotebookLine:
    """One line below the cell of a notebook that runs, written anew as the work goes on.

    Rich's bars would need ipywidgets there.
    """

    handle: ClassVar[Any] = None
    cell: ClassVar[int] = -1
    shown: ClassVar[float] = 0.0

    @classmethod
    def is_possible(cls) -> bool:
        """Return whether this is a notebook in which progress is shown."""
        return console.is_jupyter and not console.quiet and Screen.verbose > QUIET

    @classmethod
    def show(cls, text: str) -> None:
        """Show a text in place of the last one; every cell has a line of its own."""
        from IPython import display, get_ipython  # there in every notebook

        make: Any = display.display
        if cls.handle is None or cls.cell != get_ipython().execution_count:
            cls.handle = make({"text/plain": text}, raw=True, display_id=True)
            cls.cell = get_ipython().execution_count
        elif not text or time.monotonic() - cls.shown >= SHOWN:
            cls.handle.update({"text/plain": text}, raw=True)
        else:
            return
        cls.shown = time.monotonic()


def _bars() -> Progress:
    text = TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True))
    return Progress(
        BarColumn(BAR), TimeRemainingColumn(compact=True), text,
        console=console, transient=True, redirect_stdout=False, disable=not is_interactive(),
        speed_estimate_period=DAY,
    )  # fmt: skip


def _cut(depth: int) -> None:
    """End all levels from this depth on."""
    for level in Stage.levels[depth:]:
        Stage.bars.remove_task(level._task)
    del Stage.levels[depth:]
    if not Stage.levels:
        Stage.bars.stop()
        if NotebookLine.handle is not None and NotebookLine.is_possible():
            NotebookLine.show("")


def track(items: Iterable[Item], title: str | Callable[[Item], str]) -> Iterator[Item]:
    """Yield items behind a progress bar with a name for them, or for each."""
    total = len(items) if isinstance(items, Sized) else None
    with Stage(title if isinstance(title, str) else "", total) as level:
        for number, item in enumerate(items):
            level.update(number, title=title if isinstance(title, str) else title(item))
            yield item


@contextmanager
def hidden() -> Iterator[None]:
    """Draw nothing while another progress bar has the terminal."""
    Stage.bars.stop()
    try:
        yield
    finally:
        if Stage.levels:
            Stage.bars.start()


@contextmanager
def ending_stages() -> Iterator[None]:
    """Remove the levels that begin inside the context, also after an exception."""
    depth = len(Stage.levels)
    try:
        yield
    finally:
        _cut(depth)
