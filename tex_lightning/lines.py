"""Results of a task as lines on standard output, one JSON object each."""

import json
import os
import sys
from typing import Any

CLOSED_PIPE = 141  # what a shell reports of a program that SIGPIPE ended


def print_line(line: dict[str, Any]) -> None:
    """Print one JSON object at once; end quietly if nobody reads any more, as under ``| head``."""
    try:
        print(json.dumps(line), flush=True)
    except BrokenPipeError as error:
        # Python writes out what is left when it ends, and would complain again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(CLOSED_PIPE) from error
