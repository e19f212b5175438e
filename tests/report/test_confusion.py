"""Confusions of many classes: nothing lies over anything."""

from itertools import combinations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.figures import calibration_figure, confusion_figure, recall_figure


@pytest.mark.parametrize("count", [12, 69])
def test_no_name_lies_over_another(count):
    classes = [f"G{number % 9}AluminumRhombMeshVersion{number}" for number in range(count)]
    figure = confusion_figure(np.eye(count, dtype=np.int64), classes, "haptic: 12 test samples")
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


def test_bars_are_the_recall_of_each_tested_class_the_least_on_top():
    counts = np.array([[8, 2, 0], [0, 5, 5], [0, 0, 0]])
    (axes,) = recall_figure(counts, ["oak", "pine", "felt"], "haptic").axes
    named = [label.get_text() for label in axes.get_yticklabels()]
    widths = [bar.get_width() for bar in axes.patches]
    assert dict(zip(named, widths, strict=True)) == {"oak": 0.8, "pine": 0.5}  # nothing of felt
    assert named[-1] == "pine"
    assert "65.0%" in axes.get_xlabel()


def test_classes_of_equal_recall_stand_in_their_order_from_the_top():
    classes = [f"class {number:02}" for number in range(40)]
    (axes,) = recall_figure(np.roll(np.eye(40, dtype=np.int64), 1, axis=1), classes, "none").axes
    assert [label.get_text() for label in axes.get_yticklabels()][::-1] == classes


def test_a_bin_without_any_correct_sample_is_seen():
    sure = Outcome({}, "a", "b", 1, 1, 0, 1.0, probabilities='{"a": 0.1, "b": 0.9}')
    (axes,) = calibration_figure([sure], "haptic").axes
    _, points = axes.get_lines()
    (bar,) = axes.patches
    assert points.get_xydata().tolist() == [[pytest.approx(bar.get_x() + bar.get_width() / 2), 0]]
    assert points.get_marker() == "o"
