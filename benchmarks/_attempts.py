"""Damaged files given to their readers: what came of each, in which time and memory."""

import faulthandler
import os
import re
import resource
import signal
import tempfile
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning.errors import UserError
from tex_lightning.text import printable

Array = np.ndarray[Any, Any]

ACCEPTED, REFUSED, WRONG = "accepted", "refused", "wrong"
SECONDS = 20.0  # for one file
LONGEST = 900  # characters of a sentence
MEMORY = 8 << 30  # bytes that the process may grow by
LARGEST = 3e38  # of the numbers that a reader may give
SENTENCES = re.compile(r"[.!?] +[A-Z][a-z]")
STDERR = os.dup(2)  # whatever is done to the other
STATUS = Path("/proc/self/status")


class Hangs(BaseException):
    """A reader took too long; no reader catches it."""


@dataclass
class Attempt:
    """What one file came to.

    Attributes:
        outcome: ``accepted``, ``refused`` or ``wrong``.
        why: The sentence, or what is wrong.
        seconds: That it took.
        mebibytes: By which the peak of the resident set exceeded what it was before.
    """

    outcome: str
    why: str = ""
    seconds: float = 0.0
    mebibytes: float = 0.0


@dataclass
class Tally:
    """All files of one kind."""

    tried: int = 0
    accepted: int = 0
    refused: int = 0
    wrong: list[str] = field(default_factory=list)
    worst_seconds: float = 0.0
    worst_mebibytes: float = 0.0

    def add(self, name: str, attempt: Attempt) -> None:
        """Count one more."""
        self.tried += 1
        self.accepted += attempt.outcome == ACCEPTED
        self.refused += attempt.outcome == REFUSED
        if attempt.outcome == WRONG:
            self.wrong.append(f"{name}: {attempt.why}")
        self.worst_seconds = max(self.worst_seconds, attempt.seconds)
        self.worst_mebibytes = max(self.worst_mebibytes, attempt.mebibytes)

    def figures(self) -> dict[str, Any]:
        """For a table."""
        return {**vars(self), "wrong": len(self.wrong)}


def attempt(read: Callable[[], list[Array]], *names: str) -> Attempt:
    """Call a reader and judge what it does.

    It has to give finite numbers, or one sentence with one of the ``names`` in it; and to write
    nothing, warn of nothing and end in time.
    """
    before, begin = reset_peak(), time.perf_counter()
    with warnings.catch_warnings(record=True) as warned, captured() as noise, in_time():
        warnings.simplefilter("always")
        try:
            outcome, why = _judge(read())
        except UserError as error:
            outcome, why = _judge_sentence(str(error), names)
        except (Exception, Hangs) as error:
            outcome, why = WRONG, f"{type(error).__name__}: {error}"
    seconds, grown = time.perf_counter() - begin, peak() - before
    said = [f"warns: {each.message}" for each in warned] + [f"prints: {each}" for each in noise]
    if said:
        outcome, why = WRONG, said[0]
    return Attempt(outcome, why, seconds, grown)


def _judge(arrays: list[Array]) -> tuple[str, str]:
    for array in arrays:
        if array.dtype.kind not in "fiu" or not array.size:
            return WRONG, f"accepted as {array.dtype} {array.shape}"
        if not (np.abs(array.astype(np.float64)) < LARGEST).all():
            return WRONG, "accepted with NaN or infinity"
    return ACCEPTED, ""


def _judge_sentence(said: str, names: tuple[str, ...]) -> tuple[str, str]:
    text = printable(said)  # as the command line does
    rest = text.replace(names[0], "FILE")
    good = (
        any(name in text for name in names)
        and text.isprintable()
        and text.endswith(".")
        and len(rest) <= LONGEST
        and not SENTENCES.search(rest)
    )
    return (REFUSED, text) if good else (WRONG, f"says {text!r}")


@contextmanager
def captured() -> Iterator[list[str]]:
    """What is written to standard output and error, also by libraries in C."""
    said: list[str] = []
    with tempfile.TemporaryFile() as file:
        kept = {stream: os.dup(stream) for stream in (1, 2)}
        for stream in kept:
            os.dup2(file.fileno(), stream)
        try:
            yield said
        finally:
            for stream, copy in kept.items():
                os.dup2(copy, stream)
                os.close(copy)
            file.seek(0)
            if text := file.read().decode(errors="replace"):
                said.append(text)


@contextmanager
def in_time(seconds: float = SECONDS) -> Iterator[None]:
    """Raise :class:`Hangs` after so long; what C does not give back ends the process."""

    def stop(*_: object) -> None:
        raise Hangs(f"more than {seconds:g} s")

    earlier = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    faulthandler.dump_traceback_later(3 * seconds, exit=True, file=STDERR)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        faulthandler.cancel_dump_traceback_later()
        signal.signal(signal.SIGALRM, earlier)


def limit_memory() -> None:
    """Let this process fail where it would take the machine's memory."""
    size = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (size * resource.getpagesize() + MEMORY,) * 2)


def reset_peak() -> float:
    """Forget the peak so far; gives the resident set in MiB."""
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    return _status("VmRSS")


def peak() -> float:
    return _status("VmHWM")


def _status(name: str) -> float:
    lines = STATUS.read_text(encoding="utf-8").splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) / 1024
