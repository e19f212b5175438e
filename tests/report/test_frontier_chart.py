"""The chart of a family: order, intervals, colours, names."""

import pytest

from tex_lightning.report.frontier_chart import frontier_figure


def row(name: str, accuracy: float, ms: float, **more: bool) -> dict:
    return {
        "name": name, "vote_accuracy": accuracy, "ci_low": accuracy - 0.1,
        "ci_high": min(accuracy + 0.05, 1), "latency_ms_mean": ms, "on_frontier": False,
        "chosen": False, **more,
    }  # fmt: skip


ROWS = [row("slow", 0.9, 800), row("poor", 0.4, 1), row("good", 0.9, 7, chosen=True)]


def test_the_most_accurate_is_on_top_and_among_equals_the_fastest():
    left, right = frontier_figure(ROWS, "of mine", 0.25).axes
    assert [text.get_text() for text in left.get_yticklabels()] == ["good (chosen)", "slow", "poor"]
    assert [bar.get_width() for bar in right.patches] == [7, 800, 1]
    bars = [collection.get_segments()[0] for collection in left.collections]
    assert [tuple(bar[:, 0]) for bar in bars] == [
        pytest.approx(ends) for ends in ((0.8, 0.95), (0.8, 0.95), (0.3, 0.45))
    ]


@pytest.mark.parametrize(("chance", "drawn"), [(0.25, True), (0.01, False)])
def test_chance_is_said_and_drawn_where_it_is_near(chance, drawn):
    figure = frontier_figure(ROWS, "of mine", chance)
    assert f"chance {chance:.1%}\nblue: no other" in figure.get_suptitle()
    dotted = [line for line in figure.axes[0].get_lines() if line.get_linestyle() == ":"]
    assert len(dotted) == drawn


def test_a_single_system_and_many_have_room_for_their_names():
    heights = [
        frontier_figure([row(str(n), 1, 5) for n in range(count)], "x", 0.5).get_figheight()
        for count in (1, 12, 40)
    ]
    assert (heights[2] - heights[1]) / 28 == pytest.approx((heights[1] - heights[0]) / 11)


def test_long_names_leave_room_for_the_figures_on_a_phone():
    name = "FusionNet on EfficientNet-Lite, patch 112, half scale, sequential"
    rows = [row(name, 0.9, 5, chosen=True), row("plain", 0.8, 3)]
    (text, _) = frontier_figure(rows, "of mine", 0.5).axes[0].get_yticklabels()
    lines = text.get_text().split("\n")
    assert max(map(len, lines)) <= 26
    assert " ".join(lines) == f"{name} (chosen)"
