"""Results of a task as lines on standard output, one JSON object each."""

import io
import os
import sys
from typing import Any

from tex_lightning.text import to_json

CLOSED_PIPE = 141  # what a shell reports of a program that SIGPIPE ended


def print_line(line: dict[str, Any]) -> None:
    """Print one JSON object at once, in UTF-8; end quietly if nobody reads it, as ``| head``."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # none in a notebook
        sys.stdout.reconfigure(encoding="utf-8")
    try:
        print(to_json(line), flush=True)
    except BrokenPipeError as error:
        # Python writes out what is left when it ends, and would complain again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        raise SystemExit(CLOSED_PIPE) from error
