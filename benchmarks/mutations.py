"""Damaged files of every format, given to the readers: accepted, refused in a sentence, or wrong.

``python -m benchmarks mutations``, or with other formats and numbers ``python -m
benchmarks.mutations "wav,flac" 200``. Small valid files are written in every format
(:mod:`._seeds`) and damaged in many ways (:mod:`._mutate`), always in the same. Right is to give
finite numbers or one sentence that names the file, without warnings and prints of libraries
(:mod:`._attempts`). The formats are read one after another in processes of their own, so that none
can end the others. Needs Linux, for the peaks of memory.
"""

import json
import sys
from collections.abc import Sequence
from typing import Any

from benchmarks._trials import COUNT, NAMES, in_process


def measure(names: Sequence[str] = NAMES, count: int = COUNT) -> dict[str, Any]:
    """Counts of each format and of all, with the worst time and memory."""
    tallies = {name: in_process(name, count) for name in names}
    return {
        "tried": sum(each.tried for each in tallies.values()),
        "accepted": sum(each.accepted for each in tallies.values()),
        "refused": sum(each.refused for each in tallies.values()),
        "wrong": sum(len(each.wrong) for each in tallies.values()),
        **{name: each.figures() for name, each in tallies.items()},
    }


if __name__ == "__main__":
    chosen = sys.argv[1].split(",") if len(sys.argv) > 1 and sys.argv[1] else NAMES
    number = int(sys.argv[2]) if len(sys.argv) > 2 else COUNT
    for each in chosen:
        tally = in_process(each, number)
        print(json.dumps({each: vars(tally)}, indent=1), flush=True)
