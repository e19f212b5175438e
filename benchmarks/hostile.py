"""Hostile files through the command line: status, sentence, seconds and memory of each command.

``python -m benchmarks hostile``. Decompression bombs, headers that claim terabytes, lines of 200
MB, pickles with code in them, entities and aliases that multiply, pipes, devices, links in a circle
(:mod:`._hostile`). Each command has to end with status 2 and one sentence for each file, in little
memory, and no code of a file may run. Needs Linux, for the peaks of memory.
"""

import json
import os
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path
from typing import Any

from benchmarks._attempts import (
    LONGEST,
    SENTENCES,
    Hangs,
    captured,
    in_time,
    limit_memory,
    peak,
    reset_peak,
)
from benchmarks._hostile import MARK, commands

EACH = 120.0  # seconds for one command
SECONDS = 900.0  # for all


def measure() -> dict[str, Any]:
    """For each command its status, lines, seconds and mebibytes, and the worst of all."""
    found = run_all()
    return {
        "commands": len(found),
        "files": sum(len(each["said"]) for each in found.values()),
        "wrong": sum(bool(each["wrong"]) for each in found.values()),
        "worst_seconds": max(each["seconds"] for each in found.values()),
        "worst_mebibytes": max(each["mebibytes"] for each in found.values()),
        **found,
    }


def run_all() -> dict[str, dict[str, Any]]:
    """All commands in one fresh process, one after another."""
    with tempfile.TemporaryDirectory() as name:
        command = [sys.executable, "-m", "benchmarks.hostile", name]
        finished = subprocess.run(
            command, capture_output=True, text=True, timeout=SECONDS, check=False
        )
        lines = [json.loads(line) for line in finished.stdout.splitlines()]
        found = {line.pop("name"): line for line in lines}
        if finished.returncode or (Path(name) / MARK).exists() or Path(MARK).exists():
            found["process"] = {"wrong": finished.stderr[-2000:] or "code of a file has run"}
        return found


def run(arguments: list[str], folder: Path) -> dict[str, Any]:
    """One command line in this process, and what was wrong with what it did."""
    from tex_lightning.__main__ import main

    sys.argv = ["tex_lightning", *arguments, f"data.cache_dir={folder}/cache",
                f"hydra.run.dir={folder}/outputs"]  # fmt: skip
    before, begin = reset_peak(), os.times().elapsed
    with captured() as said, in_time(EACH):
        try:
            status = main()
        except (Exception, Hangs, SystemExit) as error:
            status = getattr(error, "code", -1)
            if status == -1:
                traceback.print_exc()
    text = "".join(said)
    title, *lines = [line for line in text.splitlines() if line.strip()] or [""]
    sentences = lines if title.endswith(":") else [title, *lines]
    wrong = [line for line in sentences if not sentence(line)]
    return {
        "status": status,
        "seconds": os.times().elapsed - begin,
        "mebibytes": peak() - before,
        "said": sentences,
        "wrong": wrong if status == 2 else [f"status {status}", *wrong],
    }


def sentence(line: str) -> bool:
    """Whether a line is one sentence that can be read."""
    plain = line.removeprefix("Error: ").removeprefix("- ")
    return plain.endswith(".") and len(plain) <= LONGEST and not SENTENCES.search(plain)


def _child(folder: Path) -> None:
    import tex_lightning.tasks.fit  # noqa: F401  # Lightning is not the memory of a file

    out = os.fdopen(os.dup(1), "w")
    listed = list(commands(folder))
    limit_memory()
    for name, arguments in listed:
        print(json.dumps({"name": name, **run(arguments, folder)}), file=out, flush=True)


if __name__ == "__main__":
    _child(Path(sys.argv[1]))
