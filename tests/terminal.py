"""A terminal that exists in memory only, and programs that run in one."""

import fcntl
import io
import os
import pty
import re
import select
import struct
import termios
from collections.abc import Sequence
from dataclasses import dataclass

import pyte

MOMENT = 0.2  # seconds between two looks at the screen
BAR = re.compile(r"^[━╸╺ ]*(\d+|-+):(\d\d|--) ")
SEQUENCE = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Screen(io.StringIO):
    """What is written is seen on a screen of so many columns and rows."""

    def __init__(self, columns: int = 80, rows: int = 24) -> None:
        super().__init__()
        self.columns = columns
        self.screen = pyte.HistoryScreen(columns, rows, history=5000, ratio=0.5)
        self.screen.set_mode(pyte.modes.LNM)  # a terminal's driver returns the carriage
        self.stream = pyte.Stream(self.screen)
        self.raw = ""

    def isatty(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self.raw += text
        self.stream.feed(text)
        return len(text)

    @property
    def lines(self) -> list[str]:
        """All that can be read, what has scrolled out of sight first."""
        gone = ["".join(row[column].data for column in range(self.columns)).rstrip()
                for row in self.screen.history.top]  # fmt: skip
        return [*gone, *(row.rstrip() for row in self.screen.display)]

    @property
    def text(self) -> str:
        return "\n".join(self.lines).rstrip()

    @property
    def cursor_is_hidden(self) -> bool:
        return bool(self.screen.cursor.hidden)

    @property
    def drawn(self) -> list[str]:
        """Every line of progress that was drawn, in order."""
        rows = [SEQUENCE.sub("", row).strip() for row in re.split("[\r\n]+", self.raw)]
        return [row for row in rows if BAR.search(row)]

    @property
    def widest(self) -> int:
        """Columns of the longest line that was written."""
        return max(len(SEQUENCE.sub("", row)) for row in re.split("[\r\n]+", self.raw))


@dataclass
class Session:
    """A program that has ended, and what its terminal has shown.

    Attributes:
        screen: At the end.
        status: It ended with this.
    """

    screen: Screen
    status: int


def run_in_terminal(
    command: Sequence[str], columns: int, rows: int, interrupt_at: str | None = None, **env: str
) -> Session:
    """Run a program in a pseudo-terminal; Ctrl-C is pressed when a text is on the screen."""
    screen = Screen(columns, rows)
    pid, terminal = pty.fork()
    if pid == 0:  # the child
        fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        os.execvpe(command[0], command, {**os.environ, "TERM": "xterm-256color", **env})
    while True:
        readable, _, _ = select.select([terminal], [], [], MOMENT)
        try:
            content = os.read(terminal, 1 << 16) if readable else None
        except OSError:  # Linux says so of an end
            break
        if content == b"":
            break
        if content:
            screen.write(content.decode(errors="replace"))
        if interrupt_at is not None and interrupt_at in screen.text:
            os.write(terminal, b"\x03")
            interrupt_at = None
    os.close(terminal)
    return Session(screen, os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
