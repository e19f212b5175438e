"""The frontier's chart, where many systems are alike."""

from dataclasses import replace
from itertools import combinations

from matplotlib.backends.backend_agg import FigureCanvasAgg

from tex_lightning.report.frontier_chart import PROCEDURE, Point, frontier_figure


def point(number: int, latency: float, accuracy: float) -> Point:
    return Point(
        f"a_long_name_of_a_system_{number}", "haptic", 10_000 * number, None, latency, latency, 1.0,
        accuracy, accuracy - 0.05, min(1, accuracy + 0.02), False, number == 3, 160, None, latency,
    )  # fmt: skip


def check_apart(boxes) -> None:
    for one, other in combinations(boxes, 2):
        across = min(one.x1, other.x1) - max(one.x0, other.x0)
        upwards = min(one.y1, other.y1) - max(one.y0, other.y0)
        assert across <= 2 or upwards <= 2  # pixels


def test_names_of_alike_systems_do_not_cover_each_other():
    points = [point(number, 10 * 1.1**number, 0.96 + 0.01 * (number % 2)) for number in range(12)]
    figure = frontier_figure(points)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    names = [text for text in figure.axes[0].texts if "a_long_name" in text.get_text()]
    assert len(names) == len(points)
    check_apart([name.get_window_extent(canvas.get_renderer()) for name in names])
    assert sum("chosen" in name.get_text() for name in names) == 1


def test_the_choice_is_named_apart_from_the_system_that_it_always_was():
    chosen = point(3, 20.0, 0.9)
    choice = replace(chosen, system="one_standard_error_rule", kind=PROCEDURE, chosen=False)
    figure = frontier_figure([point(1, 5.0, 0.8), chosen, choice])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    names = [text for text in figure.axes[0].texts if "cho" in text.get_text()]
    assert len(names) == 2
    check_apart([name.get_window_extent(canvas.get_renderer()) for name in names])
