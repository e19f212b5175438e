"""The labels of added senses on the chart."""

from itertools import pairwise

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from tex_lightning.report.frontier_chart import AddedSense, Point, frontier_figure


def point(system: str, ms: float, accuracy: float) -> Point:
    return Point(
        system, "fusion", 1000, None, ms, ms, 1.0, accuracy, accuracy - 0.1,
        min(accuracy + 0.1, 1.0), True, False, 48, 0, ms,
    )  # fmt: skip


@pytest.mark.parametrize("accuracies", [(0.8, 0.9, 1.0, 1.0), (1.0, 1.0, 1.0, 1.0)])
@pytest.mark.parametrize("ratio", [1.02, 3.0])
def test_labels_lie_inside_and_cover_neither_points_nor_each_other(accuracies, ratio):
    points = [
        point(str(n), 10 * ratio**n, accuracy) for n, accuracy in enumerate(accuracies)
    ]  # as close as neighbours can be, or far apart
    steps = [
        AddedSense(old.system, new.system, "sound", "together", 12.3, 48, 3, 0, 0.25)
        for old, new in pairwise(points)
    ]
    figure = frontier_figure(points, steps)
    FigureCanvasAgg(figure).draw()
    (axes,) = figure.axes
    texts = [text for text in axes.texts if text.get_text().startswith("+sound")]
    assert [text.get_text() for text in texts] == [
        "+sound: 3 repaired, 0 broken, +12.3 ms (p = 0.25)"
    ] * 3
    boxes = sorted(
        (text.get_bbox_patch().get_window_extent() for text in texts), key=lambda b: b.y0
    )
    frame = axes.get_window_extent()
    lowest = axes.transData.transform((1, min(each.ci_low for each in points)))[1]
    assert boxes[-1].y1 < lowest
    assert all(low.y1 <= high.y0 for low, high in pairwise(boxes))
    assert boxes[0].y0 >= frame.y0
    assert all(frame.x0 <= box.x0 and box.x1 <= frame.x1 for box in boxes)
