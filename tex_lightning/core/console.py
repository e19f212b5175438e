"""Messages on standard error and in the log, filtered by ``verbose``.

Standard output belongs to results. Libraries that read damaged files are silenced here, since one
sentence of this package names such a file.
"""

import io
import logging
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, ClassVar

from rich.console import Console
from rich.text import Text

from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.errors import UserError, reason
from tex_lightning.text import printable_lines, to_json

QUIET, NORMAL, DEBUG = 0, 1, 2  # values of the key ``verbose``
# Whose messages concern the user; others' only from warnings on.
OWN = ("tex_lightning", "hydra", "hydra_plugins")
STYLES = {logging.WARNING: "yellow", logging.ERROR: "red", logging.CRITICAL: "red"}
log = logging.getLogger(__name__)


class PlainConsole(Console):
    """Show every string as it is written: no markup, no names of emoji, no control characters."""

    def __init__(self, **options: Any) -> None:  # noqa: ANN401  (Rich's)
        super().__init__(stderr=True, markup=False, emoji=False, highlight=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:  # noqa: ANN401  (Rich's)
        """Make of a string, also of a cell or title of a table, what can be shown."""
        return super().render_str(printable_lines(text), **options)


console = PlainConsole(quiet=not is_rank_zero())
if console.width == 0 or not (console.is_terminal or "COLUMNS" in os.environ):
    # a log file has room for long names, and COLUMNS=0 none for any
    console = PlainConsole(width=120, quiet=console.quiet)


def show_rank_zero(*, libraries: bool = True) -> None:
    """Show nothing of a process that only trains.

    Args:
        libraries: Whether logs and warnings of libraries are suppressed as well, which is not for a
            program in Python that calls this package.
    """
    console.quiet = not is_rank_zero()
    if console.quiet and libraries:
        logging.disable()
        warnings.simplefilter("ignore")


class Screen:
    """What this process shows at present.

    Attributes:
        verbose: ``QUIET``, ``NORMAL`` or ``DEBUG``.
        job: Such as ``Job 3: ``, of a sweep whose jobs run side by side: no line can be redrawn.
        sweep: Whether a table of all jobs follows.
        logged: What is not logged again: of warnings of libraries the line of code.
    """

    verbose: ClassVar[int] = NORMAL
    job: ClassVar[str] = ""
    sweep: ClassVar[bool] = False
    logged: ClassVar[set[str]] = set()


@contextmanager
def verbosity(verbose: int) -> Iterator[None]:
    """Show that much, as long as this lasts."""
    logger, before = logging.getLogger("tex_lightning"), Screen.verbose
    level = logger.level
    Screen.verbose, Screen.logged = verbose, set()
    if verbose >= DEBUG:
        logger.setLevel(logging.DEBUG)
    try:
        with warnings.catch_warnings():
            if verbose == QUIET:
                warnings.simplefilter("ignore")
            warnings.showwarning = _warn
            yield
    finally:
        Screen.verbose = before
        logger.setLevel(level)


def _warn(
    message: object, category: object, filename: str, lineno: int, *_: object, **__: object
) -> None:
    """Log a library's warning in one line, once for each line of its code."""
    origin = f"{filename}:{lineno}"
    if origin not in Screen.logged:
        Screen.logged.add(origin)
        log.warning("%s (%s)", " ".join(str(message).split()), Path(origin).name)


def is_interactive() -> bool:
    """Return whether a line can be drawn again: on a terminal that this process has for itself.

    ``FORCE_COLOR`` makes a file look like a terminal to Rich, and ``TERM=dumb`` is one without
    the control characters that it takes.
    """
    alone = not (console.quiet or Screen.job) and Screen.verbose > QUIET
    return alone and console.is_interactive and console.file.isatty()


def log_once(
    logger: logging.Logger, text: str, level: int = logging.INFO, *, key: str = ""
) -> None:
    """Log a message that is the same for every fold, or of all that have a key the first."""
    if (key or text) not in Screen.logged:
        Screen.logged.add(key or text)
        logger.log(level, "%s", text)


def say(text: str, style: str = "", *, wraps: bool = True) -> None:
    """Print a sentence at any value of ``verbose``; a command to copy does not wrap."""
    wraps, live = wraps and console.is_terminal, console._live_stack
    with live[0]._lock if live else nullcontext():  # else Rich's thread redraws bars in between
        console.print(Text(printable_lines(text), style), soft_wrap=not wraps)


class ConsoleHandler(logging.Handler):
    """Messages above the progress bar, in whole words on a terminal, as many as ``verbose`` lets.

    The configuration of logging names this class; its formats may have ``%(severity)s``, which is
    empty up to warnings, and says which job it is where several run.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """Print one message."""
        concerns_user = record.name.partition(".")[0] in OWN
        normal = logging.INFO if concerns_user else logging.WARNING
        least = {QUIET: logging.ERROR, NORMAL: normal}.get(Screen.verbose, logging.DEBUG)
        if record.levelno < least:
            return
        grave = record.levelno >= logging.WARNING
        severity = f"{record.levelname.capitalize()}: " if grave else ""
        record.severity = Screen.job + severity
        text = self.format(record) + ("" if concerns_user else f" ({record.name})")
        # several lines of others are a table, as Lightning's of the layers
        wraps = not record.exc_info and (concerns_user or "\n" not in text)
        say(text, STYLES.get(record.levelno, ""), wraps=wraps)


@contextmanager
def showing_messages() -> Iterator[None]:
    """Print messages of a program in Python, as far as ``verbose`` allows; ``QUIET`` prints none.

    A program that configured logging gets the messages as it wants them.
    """
    logger = logging.getLogger("tex_lightning")
    level, handler, quiet = logger.level, ConsoleHandler(), console.quiet
    handler.setFormatter(logging.Formatter("%(severity)s%(message)s"))
    handled = logger.hasHandlers()
    if not handled:
        logger.addHandler(handler)
    if Screen.verbose == QUIET:
        logger.setLevel(logging.ERROR)
        console.quiet = True
    elif not handled and level == logging.NOTSET:
        logger.setLevel(logging.INFO if Screen.verbose < DEBUG else logging.DEBUG)
    try:
        yield
    finally:
        logger.removeHandler(handler)
        logger.setLevel(level)
        console.quiet = quiet


CLOSED_PIPE = 141  # what a shell reports of a program that SIGPIPE ended


def print_line(line: dict[str, Any]) -> None:
    """Print one JSON object at once, in UTF-8; end quietly if nobody reads it, as ``| head``.

    Raises:
        UserError: If it cannot be written, as on a full disk.
    """
    if isinstance(sys.stdout, io.TextIOWrapper):  # none in a notebook
        sys.stdout.reconfigure(encoding="utf-8")
    try:
        print(to_json(line), flush=True)
    except BrokenPipeError as error:
        # Python writes out what is left when it ends, and would complain again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(CLOSED_PIPE) from error
    except OSError as error:
        raise UserError(
            f"The output cannot be written ({reason(error)}); send it elsewhere."
        ) from error


class LogFile(logging.FileHandler):
    """A log that ends where the disk is full; what cannot be written there is still printed."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record without control characters, which ``cat`` would send to a terminal."""
        return printable_lines(super().format(record))

    def emit(self, record: logging.LogRecord) -> None:
        """Write a record; the folder of a run that did not begin is gone, and so is its log."""
        with suppress(FileNotFoundError):
            super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:
        """Report faults of the program alone."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)


@contextmanager
def suppress_warnings() -> Iterator[None]:
    """Collect the warnings of libraries while they read.

    The filters of warnings are those of the process: threads read inside of one such block.
    """
    with warnings.catch_warnings():
        for category in (UserWarning, RuntimeWarning):
            warnings.simplefilter("ignore", category)
        yield
