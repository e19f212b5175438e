"""A terminal that exists in memory only, and programs that run in one."""

import io
import re

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
