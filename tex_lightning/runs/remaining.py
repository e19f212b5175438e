"""How far the measuring of a family has come, and about how long it will take yet."""

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from statistics import fmean

log = logging.getLogger(__name__)


class Remaining:
    """Folds of systems that are still to be measured.

    Args:
        systems: Names of all systems, in their order.
        folds: All folds that are tested.
        pairs: System and fold of what no earlier run has measured, in the order of work.
    """

    def __init__(
        self, systems: Sequence[str], folds: Sequence[int], pairs: Sequence[tuple[str, int]]
    ) -> None:
        self.systems, self.folds, self.pairs = list(systems), list(folds), list(pairs)
        self._seconds: dict[str, list[float]] = {}

    @contextmanager
    def measuring(self, system: str, fold: int) -> Iterator[None]:
        """Say what is measured next, and take its time."""
        log.info(
            "System %d of %d (%s), fold %d of %d%s.",
            self.systems.index(system) + 1, len(self.systems), system,
            self.folds.index(fold) + 1, len(self.folds), self._estimate(),
        )  # fmt: skip
        begin = time.monotonic()
        yield
        self._seconds.setdefault(system, []).append(time.monotonic() - begin)
        self.pairs.remove((system, fold))

    def seconds_left(self) -> float | None:
        """Expected seconds of all that is left; None before anything was measured.

        A fold takes as long as its system's folds before it took on average, and one of a system
        without any as long as the systems before.
        """
        if not self._seconds:
            return None
        means = {system: fmean(taken) for system, taken in self._seconds.items()}
        typical = fmean(means.values())
        return sum(means.get(system, typical) for system, _ in self.pairs)

    def _estimate(self) -> str:
        seconds = self.seconds_left()
        return "" if seconds is None else f", about {format_seconds(seconds)} left"


def format_seconds(seconds: float) -> str:
    """A length of time to two digits or so: 40 s, 4 min, 1.5 h."""
    if seconds < 60:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
