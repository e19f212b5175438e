"""The chart of ``task=frontier``, of a report's table: ``python docs/draw_frontier.py``."""

import re
from pathlib import Path
from typing import Any

from tex_lightning.evaluation.comparison import pareto
from tex_lightning.report.figures import save_figure
from tex_lightning.report.frontier_chart import frontier_figure

DOCS = Path(__file__).parent
REPORT = DOCS / "reports" / "2026-11-23-frontier.md"
NAMES = {  # of the systems of the table, as ``task=frontier`` writes them
    "bands": "Band proportions",
    "mfcc_gmm": "MFCC + GMM",
    "mfcc_nb": "Modified MFCC decreasing + naive Bayes",
    "minirocket_1000": "MiniRocket, kernels 1000",
    "minirocket": "MiniRocket",
}


def rows() -> list[dict[str, Any]]:
    """Return the systems of the report's table as rows of ``frontier.csv``."""
    pattern = r"^\| (\**)`(\w[\w.]*)`.*? \| (\d+)/160 \| ([\d.]+) to ([\d.]+) % \|.*\| ([\d.]+) \|$"
    found = re.findall(pattern, REPORT.read_text(encoding="utf-8"), re.MULTILINE)
    table = [
        {
            "name": NAMES.get(name, name.replace("hapticnet_w", "HapticNet, width ")),
            "vote_accuracy": int(correct) / 160,
            "ci_low": float(low) / 100,
            "ci_high": float(high) / 100,
            "latency_ms_mean": float(ms),
            "chosen": bool(bold),
        }
        for bold, name, correct, low, high, ms in found
    ]
    points = {row["name"]: (row["latency_ms_mean"], row["vote_accuracy"]) for row in table}
    return [{**row, "on_frontier": row["name"] in pareto(points)} for row in table]


if __name__ == "__main__":
    save_figure(
        frontier_figure(rows(), "160 strokes (sound) of 16 surfaces", 1 / 16), DOCS / "frontier"
    )
