"""The log of a run in its folder."""

import logging
import sys


class LogFile(logging.FileHandler):
    """A log that ends where the disk is full; what cannot be written there is still printed."""

    def handleError(self, record: logging.LogRecord) -> None:
        """Report faults of the program alone."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)
