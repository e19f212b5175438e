"""The chart of accuracy and latency, of a report's table: ``python docs/draw_frontier.py``."""

import re
from pathlib import Path

from matplotlib.figure import Figure

DOCS = Path(__file__).parent
REPORT = DOCS / "reports" / "2026-11-23-frontier.md"
OUT = DOCS / "frontier.png"
GREY = "#6b6b6b"
# System of the table: its name in the chart, and its colour.
LABELS = {
    "bands": ("band proportions", "#c4500c"),
    "hapticnet_w0.0625": ("HapticNet, width 0.0625", GREY),
    "hapticnet_w0.125": ("HapticNet, width 0.125", GREY),
    "hapticnet_w0.25": ("HapticNet, width 0.25", GREY),
    "hapticnet_w0.5": ("HapticNet, width 0.5", "#1f6fb2"),
    "mfcc_gmm": ("MFCC + GMM", GREY),
    "mfcc_nb": ("MFCC + naive Bayes", GREY),
    "minirocket_1000": ("MiniRocket, 1000 kernels", GREY),
    "minirocket": ("MiniRocket", "#5b3a8e"),
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
    """Return the chart: a row for each system, its accuracy on the left and its time on the right.

    The most accurate system is on top, and among equals the fastest.
    """
    figure = Figure(figsize=(8, 3.9), layout="constrained", dpi=140)
    left, right = figure.subplots(1, 2, sharey=True)
    systems = sorted(rows(), key=lambda row: (-row[1], row[4]))
    for place, (name, accuracy, low, high, ms) in enumerate(systems):
        colour = LABELS[name][1]
        spread = [[accuracy - low], [max(0, high - accuracy)]]
        left.errorbar(accuracy, place, xerr=spread, color=colour, marker="o", capsize=3)
        left.text(102, place, f"{accuracy:.1f}", va="center", color=colour)
        right.barh(place, ms, height=0.55, color=colour)
        right.text(ms + 1.5, place, f"{ms:.1f}", va="center", color=colour)
    left.set_yticks(range(len(systems)), [LABELS[name][0] for name, *_ in systems])
    for label, (name, *_) in zip(left.get_yticklabels(), systems, strict=True):
        label.set_color(LABELS[name][1])
    left.invert_yaxis()
    left.set_xlim(60, 109)
    left.set_xticks(range(60, 101, 10))
    left.set_title("recording accuracy, %, with 95 % interval", fontsize=10, loc="left")
    right.set_xlim(0, 95)
    right.set_title("ms for one stroke of 4.8 s, one thread", fontsize=10, loc="left")
    for axes in (left, right):
        axes.grid(axis="x", alpha=0.25)
        axes.set_axisbelow(True)
        axes.tick_params(axis="y", length=0)
        axes.spines[["top", "right", "left"]].set_visible(False)
    figure.suptitle("160 strokes (sound) of 16 surfaces", fontsize=12)
    return figure


if __name__ == "__main__":
    draw().savefig(OUT)
