"""Progress and remaining time of measuring a family."""

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from statistics import fmean

from tex_lightning.core.progress import format_seconds

log = logging.getLogger(__name__)


class Remaining:
    """Folds of systems that are still to be measured.

    Args:
        systems: Names of all systems, in their order.
        left: System and pair of folds of what no earlier run has measured, in the order of work.
    """

    def __init__(self, systems: Sequence[str], left: Sequence[tuple[str, tuple[int, int]]]) -> None:
        self.systems, self.left = list(systems), list(left)
        self._seconds: dict[str, list[float]] = {}
        self._began: float | None = None  # the one that is being measured

    @contextmanager
    def measuring(self, system: str, pair: tuple[int, int]) -> Iterator[None]:
        """Announce what is measured next, and time it."""
        own = [name for name, _ in self.left].count(system)
        log.info(
            "System %d of %d (%s), trained without folds %d and %d%s%s.",
            self.systems.index(system) + 1, len(self.systems), system, *pair,
            f", {own - 1} more to train" if own > 1 else "", self._estimate(),
        )  # fmt: skip
        self._began = time.monotonic()
        yield
        self._seconds.setdefault(system, []).append(time.monotonic() - self._began)
        self._began = None
        self.left.remove((system, pair))

    def seconds_left(self) -> float | None:
        """Expected seconds of all that is left; None before anything was measured.

        A training takes as long as those of its system before it took on average, and one of a
        system without any as long as the systems before.
        """
        if not self._seconds:
            return None
        means = {system: fmean(taken) for system, taken in self._seconds.items()}
        typical = fmean(means.values())
        spent = 0.0 if self._began is None else time.monotonic() - self._began
        return max(sum(means.get(system, typical) for system, _ in self.left) - spent, 0.0)

    def _estimate(self) -> str:
        seconds = self.seconds_left()
        return "" if seconds is None else f", about {format_seconds(seconds)} left"
