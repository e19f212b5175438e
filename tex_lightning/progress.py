"""How far the work is: one line with one bar on a terminal, a sentence a minute elsewhere.

Work is nested: folds have networks, networks epochs. The bar is of all of it, so that it never
begins anew, and the line says where in it the work is.
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager
from typing import ClassVar, TypeVar

from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from tex_lightning.screen import QUIET, Screen, console, is_interactive

Item = TypeVar("Item")

REDRAWN = 0.1  # seconds between two drawings
TOLD = 60.0  # seconds between two sentences where nothing can be redrawn
SURE = 1.0  # seconds after which the time that is left is estimated
NARROW = 60  # columns, below which there is no bar

log = logging.getLogger(__name__)


class Stage:
    """One level of the work, from :func:`stage` or :func:`begin`.

    Args:
        title: What is counted, such as ``fold``.
        total: How many there are; None if nobody knows.
        done: How many an earlier run has done; may have a fraction.
        counted: Whether the bar of the outer levels moves with it.
        seconds_left: Knows better than the pace so far how long all will take.
    """

    def __init__(
        self,
        title: str,
        total: int | None,
        done: float = 0,
        *,
        counted: bool = True,
        seconds_left: Callable[[], float | None] | None = None,
    ) -> None:
        self.title, self.total, self.done, self.counted = title, total, done, counted
        self.seconds_left = seconds_left
        self.partly = 0.0  # of the one that is being done, once the levels inside have ended
        self.notes: list[str] = []
        self.first, self.begun = done, time.monotonic()

    def update(self, done: float, *, title: str | None = None, notes: Sequence[str] = ()) -> None:
        """Say how many are done, and what is to be read beside it, most important last."""
        self.done, self.partly = done, 0.0
        self.title = self.title if title is None else title
        self.notes = list(notes) or self.notes
        Work.show()

    def end(self) -> None:
        """Take this level away, and what is left of those inside."""
        if self in Work.stages:
            log.debug("%s: %.2f s.", self.title, time.monotonic() - self.begun)
            place = Work.stages.index(self)
            if place and self.counted:
                Work.stages[place - 1].partly = share([self])
            del Work.stages[place:]
            Work.show(now=True)

    @property
    def label(self) -> str:
        """Such as ``fold 3/10``."""
        if self.total is None or self.total < 2:
            return self.title
        return f"{self.title} {min(int(self.done) + 1, self.total)}/{self.total}"


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
            cls.told = moment
            log.info("%s", sentence(cls.stages))

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
    return _enter(Stage(title, total, done, counted=counted))


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


def share(stages: Sequence[Stage], *, first: bool = False) -> float:
    """Share in [0, 1] of all work that is done, or of the first, that was before it began.

    Only levels that are counted do, or where none is, the outermost.
    """
    part, total = 0.0, 1.0
    for each in [each for each in stages if each.counted] or stages[:1]:
        if each.total:
            part += total * (each.first if first else each.done + each.partly) / each.total
            total /= each.total
        if first:
            break
    return min(part, 1.0)


def seconds_left(stages: Sequence[Stage]) -> float | None:
    """Estimate of the seconds until the outermost level ends; None while nobody knows."""
    outer = next((each for each in stages if each.counted), stages[0])
    if outer.seconds_left is not None:
        return outer.seconds_left()
    elapsed = time.monotonic() - outer.begun
    done, before = share(stages), share(stages, first=True)
    if elapsed < SURE or done <= before or done == 1:
        return None
    return elapsed * (1 - done) / (done - before)


def format_seconds(seconds: float) -> str:
    """A length of time to two digits or so: 40 s, 4 min, 1.5 h."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def describe(stages: Sequence[Stage], width: int | None = None) -> str:
    """Where the work is, with as much of it as fits."""
    first, *inner = [each.label for each in stages]
    labels = [first, *(label[0].lower() + label[1:] for label in inner)]
    notes = [note for each in stages for note in each.notes]
    while width is not None and len(", ".join([*labels, *notes])) > width:
        if notes:
            del notes[0]
        elif len(labels) > 2:  # the outermost and the innermost say most
            del labels[1]
        else:
            break
    return ", ".join([*labels, *notes])


def sentence(stages: Sequence[Stage]) -> str:
    """How far the work is, for a log."""
    left = seconds_left(stages)
    estimate = "" if left is None else f", about {format_seconds(left)} left"
    return f"{share(stages):.0%} done{estimate}: {describe(stages)}."


def line(stages: Sequence[Stage], width: int) -> Table:
    """Bar, share, time that is left, and where the work is, in so many columns."""
    done, left = share(stages), seconds_left(stages)
    percent = f"{min(int(100 * done), 99):>2} %"
    estimate = "" if left is None or left < SURE else f"{format_seconds(left)} left"
    grid = Table.grid(padding=(0, 1), pad_edge=False)
    bar = 0 if width < NARROW else width // 10
    room = width - (bar + 1 if bar else 0) - 5 - 12 - 1
    cells: list[ProgressBar | str] = [percent, estimate, describe(stages, room)]
    sizes = [4, 11, room]
    if bar:
        cells, sizes = [ProgressBar(1.0, done, width=bar), *cells], [bar, *sizes]
    for size in sizes:
        grid.add_column(width=size, no_wrap=True, overflow="ellipsis")
    grid.add_row(*cells)
    return grid
