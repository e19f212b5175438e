"""Confusions of many classes: nothing lies over anything."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from tex_lightning.report.figures import confusion_figure

LONG = "AluminumRhombMeshVersion"


def lmt_names(count: int) -> list[str]:
    """As LMT-108's, in nine categories of unequal size."""
    rng = np.random.default_rng(0)
    return [f"G{kind}{LONG}{i}" for i, kind in enumerate(np.sort(rng.integers(1, 10, count)))]


def blocks(count: int, size: int) -> np.ndarray:
    """Ten samples a class, three of them taken for the next class of its block."""
    counts = 7 * np.eye(count, dtype=np.int64)
    for i in range(count):
        begin = i // size * size
        counts[i, begin + (i + 1 - begin) % min(size, count - begin)] += 3
    return counts


def overlaps(figure) -> list[tuple[str, str]]:
    """Pairs of texts that lie over each other by more than a pixel, and texts that are cut."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer = canvas.get_renderer()
    texts = [text for text in figure.findobj(Text) if text.get_text() and text.get_visible()]
    boxes = {text: text.get_window_extent(renderer) for text in texts}
    width, height = canvas.get_width_height()
    found = [
        (text.get_text(), "the edge")
        for text, box in boxes.items()
        if box.x0 < -1 or box.y0 < -1 or box.x1 > width + 1 or box.y1 > height + 1
    ]
    for (one, a), (other, b) in combinations(boxes.items(), 2):
        across, upwards = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        if across > 1 and upwards > 1:
            found.append((one.get_text(), other.get_text()))
    return found


@pytest.mark.parametrize(
    ("count", "named"),
    [
        (12, True), (69, True), (69, False),
        pytest.param(108, True, marks=pytest.mark.slow),
        pytest.param(108, False, marks=pytest.mark.slow),
        pytest.param(1000, True, marks=pytest.mark.slow),
        pytest.param(1000, False, marks=pytest.mark.slow),
    ],
)  # fmt: skip
def test_no_text_lies_over_another(count, named):
    classes = lmt_names(count) if named else [f"{LONG.lower()} {i}" for i in range(count)]
    counts = blocks(count, 7)
    assert overlaps(confusion_figure(counts, classes, "haptic: votes on 690 samples")) == []


def test_a_matrix_of_very_many_classes_is_no_larger():
    """Of a thousand it would take two gigabytes, and no picture so large is read again."""
    names, counts = [f"m{at % 10} {at}" for at in range(400)], np.eye(400, dtype=np.int64)
    largest = confusion_figure(counts[:150, :150], names[:150], "t")
    figure = confusion_figure(counts, names, "t")
    assert figure.get_size_inches() == pytest.approx(largest.get_size_inches())
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == []
