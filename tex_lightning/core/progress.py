"""How far the work is: Rich's bars on a terminal, a line a minute elsewhere.

Work is nested: folds have networks, networks epochs. Each level has a bar below the outer one.
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager
from typing import ClassVar, TypeVar

from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Column

from tex_lightning.core.console import QUIET, Screen, console, is_interactive, tell
from tex_lightning.text import printable

Item = TypeVar("Item")
BAR = 16  # columns
REDRAWN = 0.1  # seconds between two drawings
TOLD = 60.0  # seconds between two lines where nothing can be redrawn
DAY = 24 * 3600.0  # seconds that a pace is taken from, at most
log = logging.getLogger(__name__)


class Stage:
    """A level of the work, inside those that are begun and have not ended.

    Args:
        title: What is counted, such as ``fold``, or the name of the one that is being done.
        total: How many there are; None if nobody knows.
        done: How many an earlier run has done.
    """

    levels: ClassVar[list["Stage"]] = []
    bars: ClassVar[Progress] = Progress(auto_refresh=False)
    hidden: ClassVar[bool] = False
    drawn: ClassVar[float] = 0.0
    told: ClassVar[float] = 0.0

    def __init__(self, title: str, total: int | None, done: float = 0) -> None:
        if not Stage.levels:
            Stage.bars, Stage.told = _bars(), time.monotonic()
        self.title, self.total, self.done, self.note = title, total, done, ""
        self.began = time.monotonic()
        self._task = Stage.bars.add_task("", total=total, completed=done)  # type: ignore[arg-type]
        Stage.levels.append(self)
        self.update(done)

    @property
    def label(self) -> str:
        """Such as ``fold 3/10, loss 0.12``."""
        counted = self.total is not None and self.total > 1
        count = f" {min(int(self.done) + 1, self.total or 0)}/{self.total}" if counted else ""
        return printable(f"{self.title}{count}{self.note and f', {self.note}'}")

    def update(self, done: float, *, title: str | None = None, notes: Sequence[str] = ()) -> None:
        """Say how many are done, and what is to be read beside it."""
        self.done, self.title = done, title or self.title
        self.note = ", ".join(notes) or self.note
        Stage.bars.update(self._task, completed=done, description=self.label)
        _show()

    def end(self) -> None:
        """Take this level away, and what is left of those inside."""
        if self not in Stage.levels:
            return
        log.debug("%s: %.2f s.", self.title, time.monotonic() - self.began)
        _cut(Stage.levels.index(self))


def _bars() -> Progress:
    text = TextColumn("{task.description}", markup=False, table_column=Column(no_wrap=True))
    return Progress(
        BarColumn(BAR), TimeRemainingColumn(compact=True), text,
        console=console, transient=True, auto_refresh=False, redirect_stdout=False,
        speed_estimate_period=DAY,
    )  # fmt: skip


def _cut(depth: int) -> None:
    """End all levels from this depth on."""
    for level in Stage.levels[depth:]:
        Stage.bars.remove_task(level._task)
    del Stage.levels[depth:]
    _show(now=True)


def _show(*, now: bool = False) -> None:
    """Draw the bars, or log a line, if it is time to."""
    moment, drawable = time.monotonic(), is_interactive() and not Stage.hidden
    if not Stage.levels or not drawable:
        Stage.bars.live.stop()
    elif now or moment - Stage.drawn >= REDRAWN:
        Stage.drawn = moment
        Stage.bars.start()
        Stage.bars.refresh()
    due = moment - Stage.told >= TOLD and Screen.verbose > QUIET
    if Stage.levels and due and not is_interactive():
        Stage.told = moment
        said = f"{'; '.join(level.label for level in Stage.levels)}."
        # a notebook seldom configures logging
        log.info("%s", said) if log.hasHandlers() else tell(said)


@contextmanager
def stage(title: str, total: int, done: float = 0) -> Iterator[Stage]:
    """A level of the work, as a ``with`` block."""
    entered = Stage(title, total, done)
    try:
        yield entered
    finally:
        entered.end()


def steps(items: Sequence[Item], title: str | Callable[[Item], str]) -> Iterator[Item]:
    """Yield items behind a bar that says what they are, or the name of each."""
    with stage("", len(items)) as level:
        for number, item in enumerate(items):
            level.update(number, title=title if isinstance(title, str) else title(item))
            yield item


def track(items: Iterable[Item], title: str) -> Iterator[Item]:
    """Yield items behind a bar."""
    entered = Stage(title, len(items) if isinstance(items, Sized) else None)
    try:
        for number, item in enumerate(items):
            entered.update(number)
            yield item
    finally:
        entered.end()


@contextmanager
def hidden() -> Iterator[None]:
    """Draw nothing as long as another one draws."""
    Stage.hidden = True
    _show()
    try:
        yield
    finally:
        Stage.hidden = False


@contextmanager
def finishing() -> Iterator[None]:
    """Take away the levels that are begun inside, whatever ends them."""
    depth = len(Stage.levels)
    try:
        yield
    finally:
        _cut(depth)
