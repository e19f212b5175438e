"""Confusions of many classes: nothing lies over anything."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tex_lightning.report.figures import confusion_figure


@pytest.mark.parametrize("count", [12, 69])
def test_no_name_lies_over_another(count):
    classes = [f"G{number % 9}AluminumRhombMeshVersion{number}" for number in range(count)]
    figure = confusion_figure(np.eye(count, dtype=np.int64), classes, "haptic: votes")
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    renderer, (axes, *_) = canvas.get_renderer(), figure.axes
    for labels in (axes.get_xticklabels(), axes.get_yticklabels()):
        assert len(labels) == count
        boxes = [label.get_window_extent(renderer) for label in labels]
        for one, other in combinations(boxes, 2):
            across = min(one.x1, other.x1) - max(one.x0, other.x0)
            upwards = min(one.y1, other.y1) - max(one.y0, other.y0)
            assert min(across, upwards) <= 1


def test_a_matrix_of_very_many_classes_is_no_larger():
    """Of a thousand it would take two gigabytes, and no picture so large is read again."""
    names, counts = [f"m{at % 10} {at}" for at in range(400)], np.eye(400, dtype=np.int64)
    largest = confusion_figure(counts[:150, :150], names[:150], "t")
    figure = confusion_figure(counts, names, "t")
    assert figure.get_size_inches() == pytest.approx(largest.get_size_inches())
    assert [label.get_text() for label in figure.axes[0].get_yticklabels()] == []
