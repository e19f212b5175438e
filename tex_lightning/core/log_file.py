"""The log of a run in its folder."""

import logging
import sys

from tex_lightning.text import printable_lines


class LogFile(logging.FileHandler):
    """A log that ends where the disk is full; what cannot be written there is still printed."""

    def format(self, record: logging.LogRecord) -> str:
        """Format a record without control characters, which ``cat`` would send to a terminal."""
        return printable_lines(super().format(record))

    def handleError(self, record: logging.LogRecord) -> None:
        """Report faults of the program alone."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)
