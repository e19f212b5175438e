"""How long a prediction takes to start, as a ratio to importing PyTorch alone.

``python -m benchmarks startup --rounds=5``
"""

import sys
import tempfile
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks._commands import command, output
from tex_lightning.studies.timing import interleaved

TINY = ("debug=tiny", "data.classes=2", "logger=csv")


def measure(rounds: str = "5") -> dict[str, Any]:
    """Medians in seconds of whole processes, interleaved, and ratios to ``import torch``."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        output(command(folder, "haptic", ("model=haptic", *TINY)), folder)
        trace = min(folder.glob("cache/**/haptic/*.npy"))
        predict = ("task=predict", f"checkpoint={folder}/runs/haptic", f"haptic={trace}")
        run = [sys.executable, "-c"]
        commands = {
            "import torch": [*run, "import torch"],
            "import for a prediction": [*run, "import tex_lightning as tl; tl.load"],
            "first label": [sys.executable, "-m", "tex_lightning", *predict],
        }
        calls = {case: partial(output, line, folder) for case, line in commands.items()}
        timings = interleaved(calls, int(rounds))
    seconds = {case: timing.median / 1000 for case, timing in timings.items()}
    torch = seconds["import torch"]
    return {f"{case}, s": value for case, value in seconds.items()} | {
        f"{case}, ratio": value / torch for case, value in seconds.items() if value != torch
    }
