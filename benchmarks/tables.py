"""How long a table of samples takes to read, as a ratio to ``pandas.read_csv``.

``python -m benchmarks tables --rows=1000000 --rounds=3``
"""

import tempfile
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from tex_lightning.studies.timing import interleaved
from tex_lightning_runtime.tables import read_table

RATE = 2000  # Hz


def measure(rows: str = "1000000", rounds: str = "3") -> dict[str, Any]:
    """Medians in seconds of both, interleaved, and their ratio, for several kinds of tables."""
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        for kind, (frame, how) in kinds(int(rows)).items():
            path = Path(folder) / f"{kind}.csv"
            frame.to_csv(path, index=False, **how)
            calls = {"pandas": partial(pd.read_csv, path, **how), "ours": partial(read_table, path)}
            timings = interleaved(calls, int(rounds))
            seconds = {name: timing.median / 1000 for name, timing in timings.items()}
            figures[f"{kind}, s"] = seconds["ours"]
            figures[f"{kind}, ratio"] = seconds["ours"] / seconds["pandas"]
            path.unlink()
    return figures


def kinds(rows: int) -> dict[str, tuple[pd.DataFrame, dict[str, str]]]:
    """Tables of three axes and a time, and how they are written."""
    axes = np.random.default_rng(0).uniform(-1, 1, (rows, 3)).round(5)
    plain = pd.DataFrame(axes, columns=["x", "y", "z"])
    plain.insert(0, "time", np.arange(rows) / RATE)
    since = pd.to_timedelta(np.arange(rows) * (10**9 // RATE), unit="ns")
    stamps = pd.Timestamp("2026-03-01T10:00:00.0005") + since
    return {
        "seconds": (plain, {}),
        "one axis": (plain[["x"]], {}),
        "decimal commas": (plain, {"sep": ";", "decimal": ","}),
        "ISO times": (plain.assign(time=stamps.astype(str)), {}),
        "counter and label": (plain.assign(packet=np.arange(rows), label="walk"), {}),
    }
