"""Commands of the package in processes of their own, which real signals can end.

A process is forked after everything is imported, leads a session of its own and runs the package's
main entry with a command line: importing takes far longer than what is to be disturbed.
"""

import os
import re
import signal
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from tex_lightning.__main__ import main

HANDLED = {signal.SIGINT, signal.SIGTERM}
LIMIT_S = 600.0
POLL_S = 0.005
PARTIAL = re.compile(r"^\.(.+)\.[a-z0-9_]{8}$")
NUMBERS = re.compile(r"\d{6,}.*")  # time, machine and process in the name of TensorBoard's file


@dataclass(frozen=True)
class Ended:
    """A process that is over.

    Attributes:
        status: Its exit status; of one that a signal ended its number, negative.
        said: All that it printed.
    """

    status: int
    said: str


class Running:
    """A command that runs.

    Args:
        arguments: Of the command line.
        log: File for what it prints.
        prepare: Called in the new process first.
    """

    def __init__(
        self, arguments: Sequence[str], log: Path, prepare: Callable[[], None] = lambda: None
    ) -> None:
        self.log, self._status = log, None
        before = signal.pthread_sigmask(signal.SIG_BLOCK, HANDLED)  # until the child is ready
        self.pid = os.fork()
        if self.pid == 0:
            _run(arguments, log, prepare)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)

    def is_over(self) -> bool:
        """Whether it has ended."""
        if self._status is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self._status = os.waitstatus_to_exitcode(status) if pid else None
        return self._status is not None

    def wait(self, until: Callable[[], bool] | None = None) -> bool:
        """Wait for a condition or the end; returns whether the process still runs."""
        deadline = time.monotonic() + LIMIT_S
        while not self.is_over():
            if until and until():
                return True
            if time.monotonic() > deadline:
                self.send(signal.SIGKILL)
            time.sleep(POLL_S if until else 10 * POLL_S)  # walking folders takes time, too
        return False

    def send(self, number: signal.Signals) -> None:
        """Send a signal to it and to all that it has started."""
        try:
            os.killpg(self.pid, number)
        except ProcessLookupError:  # it does not lead a session yet
            with suppress(ProcessLookupError):
                os.kill(self.pid, number)

    def end(self) -> Ended:
        """Wait for the end."""
        self.wait()
        assert self._status is not None
        return Ended(self._status, self.log.read_text(encoding="utf-8", errors="replace"))


def _run(arguments: Sequence[str], log: Path, prepare: Callable[[], None]) -> None:
    """Be the new process; never returns."""
    status = 1
    try:
        os.setsid()
        output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(output, 1)
        os.dup2(output, 2)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        sys.argv = ["tex_lightning", *arguments]
        prepare()
        signal.pthread_sigmask(signal.SIG_UNBLOCK, HANDLED)
        status = main()
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)


def run(arguments: Sequence[str], log: Path, prepare: Callable[[], None] = lambda: None) -> Ended:
    """Run a command undisturbed."""
    return Running(arguments, log, prepare).end()


def import_what_it_imports(arguments: Sequence[str], log: Path) -> Ended:
    """Run a command, and import here what it has imported, so that the next ones need not."""
    note = log.with_suffix(".modules")

    def when_done() -> None:
        keep = os._exit

        def leave(status: int) -> None:
            note.write_text("\n".join(sys.modules))
            keep(status)

        os._exit = leave  # type: ignore[assignment]

    ended = run(arguments, log, when_done)
    for name in note.read_text().split("\n"):
        if name not in sys.modules and not name.startswith("__"):
            with suppress(Exception):
                import_module(name)
    return ended


def files(*folders: Path) -> Iterator[str]:
    """Files below folders by names that are the same in every run; partial ones end with ``*``."""
    for folder in folders:
        for place, _, names in os.walk(folder):
            for name in names:
                partial = PARTIAL.match(name)
                named = f".{partial[1]}.*" if partial else NUMBERS.sub("*", name)
                yield str(Path(place, named).relative_to(folder))


def partial_files(*folders: Path) -> list[Path]:
    """What was being written, as files and folders, and was left where it was."""
    return [path for folder in folders for path in folder.rglob(".*") if PARTIAL.match(path.name)]
