"""Command lines of the package in processes of their own."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from tex_lightning.config import CONF


def run(folder: Path, case: str, arguments: Sequence[str]) -> str:
    """What a command prints, whose run folder is ``runs/CASE`` of the folder."""
    return output(command(folder, case, arguments), folder)


def command(folder: Path, case: str, arguments: Sequence[str]) -> list[str]:
    """The command line of a case."""
    common = (f"hydra.run.dir={folder}/runs/{case}", f"data.cache_dir={folder}/cache", "seed=0")
    return [sys.executable, "-m", "tex_lightning", *arguments, *common]


def environment() -> dict[str, str]:
    """One thread, and this checkout."""
    paths = f"{CONF.parent}:{CONF.parent / 'runtime'}"
    return {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": paths}


def output(arguments: list[str], folder: Path) -> str:
    done = subprocess.run(
        arguments, cwd=folder, env=environment(), capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} ended with {done.stderr[-2000:]}")
    return done.stdout
