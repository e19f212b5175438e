"""How far the work is: one line with one bar on a terminal, a sentence a minute elsewhere.

Work is nested: folds have networks, networks epochs. The bar is of all of it, so that it never
begins anew, and the line says where in it the work is (:mod:`tex_lightning.core.progress`).
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar, TypeVar

from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from tex_lightning.core.console import QUIET, Screen, console, is_interactive, tell

SURE = 1.0  # seconds after which the time that is left is estimated, and down to which it is shown
NARROW = 60  # columns, below which there is no bar
MARGIN = 3  # columns, where a terminal echoes ^C without a new line
PERCENT, ESTIMATE = 4, 11  # columns of their cells
Cell = tuple[int, ProgressBar | str]


@dataclass
class Level:
    """One level of the work.

    Attributes:
        title: What is counted, such as ``fold``, or the name of the one that is being done.
        total: How many there are; None if nobody knows.
        done: How many are done; may have a fraction.
        counted: Whether the bar of the outer levels moves with this one.
        seconds_left: Knows better than the pace so far how long all will take.
        partly: Share of the next one that is done, once the levels inside it have ended.
        notes: What is to be read beside it, most important last.
        begun: When, as :func:`time.monotonic` has it.
        first: How many were done before.
    """

    title: str
    total: int | None
    done: float = 0
    counted: bool = True
    seconds_left: Callable[[], float | None] | None = None
    partly: float = 0.0
    notes: Sequence[str] = ()
    begun: float = field(default_factory=time.monotonic)
    first: float = field(init=False)

    def __post_init__(self) -> None:
        self.first = self.done

    @property
    def label(self) -> str:
        """Such as ``fold 3/10``."""
        if self.total is None or self.total < 2:
            return self.title
        return f"{self.title} {min(int(self.done) + 1, self.total)}/{self.total}"


def share(levels: Sequence[Level]) -> float:
    """Share in [0, 1] of all work that is done.

    Only levels that are counted do, or where none is, the outermost.
    """
    part, whole = 0.0, 1.0
    for each in [each for each in levels if each.counted] or levels[:1]:
        if each.total:
            part += whole * (each.done + each.partly) / each.total
            whole /= each.total
    return min(part, 1.0)


def seconds_left(levels: Sequence[Level]) -> float | None:
    """Estimate of the seconds until the outermost level ends; None while nobody knows."""
    outer = next((each for each in levels if each.counted), levels[0])
    if outer.seconds_left is not None:
        return outer.seconds_left()
    elapsed = time.monotonic() - outer.begun
    done, before = share(levels), outer.first / (outer.total or 1)
    if elapsed < SURE or done <= before or done == 1:
        return None
    return elapsed * (1 - done) / (done - before)


def format_seconds(seconds: float) -> str:
    """A length of time to two digits or so: 40 s, 4 min, 1.5 h."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def describe(levels: Sequence[Level], width: int | None = None) -> str:
    """Where the work is, with as much of it as fits."""
    first, *inner = [each.label for each in levels]
    labels = [first, *(label[0].lower() + label[1:] for label in inner)]
    notes = [note for each in levels for note in each.notes]
    while width is not None and len(", ".join([*labels, *notes])) > width:
        if notes:
            del notes[0]
        elif len(labels) > 2:  # the outermost and the innermost say most
            del labels[1]
        else:
            break
    return ", ".join([*labels, *notes])


def _percent(levels: Sequence[Level]) -> int:
    """Whole percent of the work; 100 only the results say."""
    return min(int(100 * share(levels)), 99)


def sentence(levels: Sequence[Level]) -> str:
    """How far the work is, for a log."""
    left = seconds_left(levels)
    estimate = "" if left is None else f", about {format_seconds(left)} left"
    return f"{_percent(levels)} % done{estimate}: {describe(levels)}."


def line(levels: Sequence[Level], width: int) -> Table:
    """Bar, share, time that is left, and where the work is, in one line of so many columns."""
    done, left = share(levels), seconds_left(levels)
    cells: list[Cell] = [
        (PERCENT, f"{_percent(levels):>2} %"),
        (ESTIMATE, "" if left is None or left < SURE else f"{format_seconds(left)} left"),
    ]
    if width >= NARROW:
        cells.insert(0, (width // 10, ProgressBar(1.0, done, width=width // 10)))
    return one_line(cells, partial(describe, levels), width)


def one_line(cells: Sequence[Cell], text: Callable[[int], str], width: int) -> Table:
    """Cells of so many columns, and a text that is told how many are left of a terminal's."""
    room = width - MARGIN - sum(size + 1 for size, _ in cells)
    grid = Table.grid(padding=(0, 1), pad_edge=False)
    for size, _ in cells:
        grid.add_column(width=size, no_wrap=True, overflow="ellipsis")
    # no wider than it is: where a terminal is narrowed, it would go on in the next line
    grid.add_column(max_width=room, no_wrap=True, overflow="ellipsis")
    grid.add_row(*(cell for _, cell in cells), text(room))
    return grid


Item = TypeVar("Item")
REDRAWN = 0.1  # seconds between two drawings
TOLD = 60.0  # seconds between two sentences where nothing can be redrawn
log = logging.getLogger(__name__)


class Stage(Level):
    """A level that is being worked on, from :func:`stage` or :func:`begin`."""

    def update(self, done: float, *, title: str | None = None, notes: Sequence[str] = ()) -> None:
        """Say how many are done, and what is to be read beside it, most important last."""
        self.done, self.partly = done, 0.0
        self.title = self.title if title is None else title
        self.notes = notes or self.notes
        Work.show()

    def end(self) -> None:
        """Take this level away, and what is left of those inside."""
        if not any(each is self for each in Work.stages):
            return
        log.debug("%s: %.2f s.", self.title, time.monotonic() - self.begun)
        while Work.stages.pop() is not self:
            pass
        if Work.stages and self.counted:
            Work.stages[-1].partly = share([self])
        Work.show(now=True)


class Work:
    """The levels of the work at present, from the outermost on, and the line that shows them."""

    stages: ClassVar[list[Stage]] = []
    live: ClassVar[Live | None] = None
    drawn: ClassVar[float] = 0.0
    told: ClassVar[float] = 0.0
    hidden: ClassVar[bool] = False

    @classmethod
    def show(cls, *, now: bool = False) -> None:
        """Draw the line again, or say how far the work is, if it is time to."""
        moment, drawable = time.monotonic(), is_interactive()
        if not cls.stages or cls.hidden or not drawable:
            cls.hide()
        elif now or moment - cls.drawn >= REDRAWN:
            cls.drawn = moment
            cls._line().update(line(cls.stages, console.width), refresh=True)
        if cls.stages and not drawable and Screen.verbose > QUIET and moment - cls.told >= TOLD:
            cls.told, said = moment, sentence(cls.stages)
            # a notebook seldom configures logging
            log.info("%s", said) if log.hasHandlers() else tell(said)

    @classmethod
    def hide(cls) -> None:
        """Take the line away; the cursor is shown again."""
        if cls.live is not None:
            cls.live.stop()
            cls.live = None

    @classmethod
    def _line(cls) -> Live:
        if cls.live is None:
            cls.live = Live(
                console=console, transient=True, auto_refresh=False, redirect_stdout=False
            )
            cls.live.start()
        return cls.live


def begin(title: str, total: int | None, done: float = 0, *, counted: bool = True) -> Stage:
    """Begin a level inside the present one; whoever calls this ends it."""
    return _enter(Stage(title, total, done, counted))


def _enter(entered: Stage) -> Stage:
    if not Work.stages:
        Work.told = time.monotonic()
    Work.stages.append(entered)
    Work.show(now=True)
    return entered


@contextmanager
def stage(
    title: str, total: int, *, seconds_left: Callable[[], float | None] | None = None
) -> Iterator[Stage]:
    """A level of the work, as a ``with`` block."""
    entered = _enter(Stage(title, total, seconds_left=seconds_left))
    try:
        yield entered
    finally:
        entered.end()


def steps(items: Sequence[Item], title: str | Callable[[Item], str]) -> Iterator[Item]:
    """Yield items, each a part of the bar of the outer level.

    Args:
        items: Folds, networks or systems.
        title: What they are, or the name of each.
    """
    titles = [title if isinstance(title, str) else title(item) for item in items]
    if not titles:
        return
    with stage(titles[0], len(items)) as level:
        for number, item in enumerate(items):
            level.update(number, title=titles[number])
            yield item
        level.update(len(items))


def track(items: Iterable[Item], title: str) -> Iterator[Item]:
    """Yield items behind a bar of their own; inside other work their number alone is shown."""
    entered = begin(title, len(items) if isinstance(items, Sized) else None, counted=False)
    try:
        for number, item in enumerate(items):
            entered.update(number)
            yield item
    finally:
        entered.end()


@contextmanager
def hidden() -> Iterator[None]:
    """Draw nothing as long as another one draws."""
    Work.hidden = True
    Work.show()
    try:
        yield
    finally:
        Work.hidden = False


@contextmanager
def finishing() -> Iterator[None]:
    """Take away the levels that are begun inside, whatever ends them."""
    depth = len(Work.stages)
    try:
        yield
    finally:
        del Work.stages[depth:]
        Work.show(now=True)
