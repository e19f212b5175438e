"""The chart of accuracy against latency, of a report's table: ``python docs/draw_frontier.py``."""

import re
from pathlib import Path

from matplotlib.figure import Figure

DOCS = Path(__file__).parent
REPORT = DOCS / "reports" / "2026-11-23-frontier.md"
OUT = DOCS / "frontier.png"
GREY = "#8a8a8a"
# System of the table: its name in the chart, colour, and offset of the name in points.
LABELS = {
    "bands": ("band proportions", "#c4500c", (8, 9, "right")),
    "hapticnet_w0.0625": ("HapticNet, width 0.0625", GREY, (8, -4, "left")),
    "hapticnet_w0.125": ("HapticNet, width 0.125", GREY, (8, -4, "left")),
    "hapticnet_w0.25": ("width 0.25", GREY, (0, -28, "center")),
    "hapticnet_w0.5": ("HapticNet, default", "#1f6fb2", (0, 9, "center")),
    "mfcc_gmm": ("MFCC + GMM", GREY, (8, -14, "left")),
    "mfcc_nb": ("MFCC + naive Bayes", GREY, (-8, -4, "right")),
    "minirocket_1000": ("MiniRocket, 1000 kernels", GREY, (8, -4, "left")),
    "minirocket": ("MiniRocket", "#5b3a8e", (0, 13, "center")),
}


def rows() -> list[tuple[str, float, float, float, float]]:
    """Return system, accuracy, ends of its interval in per cent, and milliseconds."""
    pattern = r"^\| \**`(\w[\w.]*)`.*? \| (\d+)/160 \| ([\d.]+) to ([\d.]+) % \|.*\| ([\d.]+) \|$"
    found = re.findall(pattern, REPORT.read_text(encoding="utf-8"), re.MULTILINE)
    return [
        (name, int(correct) / 1.6, float(low), float(high), float(ms))
        for name, correct, low, high, ms in found
    ]


def draw() -> Figure:
    """Return the chart: the three systems to compare in colour, the others in grey."""
    figure = Figure(figsize=(9, 4.6), layout="constrained", dpi=140)
    axes = figure.add_subplot()
    for name, accuracy, low, high, ms in rows():
        label, colour, (right, up, side) = LABELS[name]
        axes.errorbar(
            ms, accuracy, [[accuracy - low], [max(0, high - accuracy)]], color=colour, capsize=2,
            marker="o", markersize=8 if colour != GREY else 5, linewidth=1.2,
        )  # fmt: skip
        axes.annotate(
            label, (ms, accuracy), (right, up), textcoords="offset points", ha=side, color=colour,
            fontsize=11 if colour != GREY else 9, fontweight="bold" if colour != GREY else "normal",
        )  # fmt: skip
    axes.set_xscale("log")
    axes.set_xticks([4, 6, 10, 20, 40, 80], ["4", "6", "10", "20", "40", "80"])
    axes.minorticks_off()
    axes.set_xlim(2.6, 130)
    axes.set_ylim(60, 104)
    axes.set_yticks(range(60, 101, 10))
    axes.set_xlabel("milliseconds for one trace of 4.8 s, features included (one thread)")
    axes.set_ylabel("recording accuracy, % (95 % interval)")
    axes.set_title("160 strokes (sound) of 16 surfaces: upper left is better", loc="left")
    axes.grid(alpha=0.25)
    axes.spines[["top", "right"]].set_visible(False)
    return figure


if __name__ == "__main__":
    draw().savefig(OUT)
