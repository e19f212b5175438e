"""What a command takes: seconds, and memory of it and all processes that it starts."""

import os
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.errors import UserError

PROC = Path("/proc")
INTERVAL = 0.05  # seconds between looks
PAGE = os.sysconf("SC_PAGE_SIZE") / 2**20 if hasattr(os, "sysconf") else 0.0  # MiB


def run_watched(command: Sequence[str], **environment: str) -> dict[str, Any]:
    """Run a command to its end.

    Returns:
        ``seconds``; ``peak_mib``, the largest sum of the resident sets of its processes;
        ``peak_own_mib``, the same without pages of files, which the system may drop at any time;
        ``output``, what it printed.

    Raises:
        UserError: If this system has no ``/proc``.
    """
    if not (PROC / "self" / "statm").is_file():
        raise UserError("Memory of processes is read from /proc, which this system lacks.")
    begin, peak, own = time.perf_counter(), 0.0, 0.0
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env={**os.environ, **environment}
    ) as process:
        while process.poll() is None:
            sizes = [resident(each) for each in tree(process.pid)]
            peak = max(peak, sum(size for size, _ in sizes))
            own = max(own, sum(size - of_files for size, of_files in sizes))
            time.sleep(INTERVAL)
        seconds = time.perf_counter() - begin
        assert process.stdout is not None
        output = process.stdout.read()
    if process.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with status {process.returncode}")
    return {
        "seconds": seconds,
        "peak_mib": peak,
        "peak_own_mib": own,
        "output": output,
    }


def tree(pid: int) -> Iterator[int]:
    """A process and all that descend from it."""
    yield pid
    for task in (PROC / str(pid) / "task").glob("*/children"):
        try:
            children = task.read_text().split()
        except OSError:  # it has ended
            continue
        for child in children:
            yield from tree(int(child))


def resident(pid: int) -> tuple[float, float]:
    """Resident set of a process, and what of it are pages of files, in MiB; 0 if it has ended."""
    try:
        _, size, of_files, *_ = (PROC / str(pid) / "statm").read_text().split()
    except OSError:
        return 0.0, 0.0
    return int(size) * PAGE, int(of_files) * PAGE
