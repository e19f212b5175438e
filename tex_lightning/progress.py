"""How far the work is: one line with one bar on a terminal, a sentence a minute elsewhere.

Work is nested: folds have networks, networks epochs. The bar is of all of it, so that it never
begins anew, and the line says where in it the work is (:mod:`tex_lightning.progress_line`).
"""

import logging
import time
from collections.abc import Callable, Iterable, Iterator, Sequence, Sized
from contextlib import contextmanager
from typing import ClassVar, TypeVar

from rich.live import Live

from tex_lightning.progress_line import Level, line, sentence, share
from tex_lightning.screen import QUIET, Screen, console, is_interactive, tell

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
