"""The chart of ``task=frontier`` names every system, and the choice."""

from tex_lightning.report.frontier_chart import frontier_figure


def test_every_system_and_the_choice_have_a_look_of_their_own():
    row = {
        "system": "haptic", "vote_accuracy": 1.0, "ci_low": 0.978, "ci_high": 1.0,
        "on_frontier": True, "chosen": True, "latency_ms_mean": 12.0,
    }  # fmt: skip
    other = {**row, "system": "haptic_w0.5", "chosen": False, "on_frontier": False}
    figure = frontier_figure([row, other])
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["haptic (chosen)", "haptic_w0.5"]
    lines = [bars.lines[0] for bars in figure.axes[0].containers]
    assert len({(line.get_marker(), line.get_color()) for line in lines}) == 2
    assert lines[1].get_markerfacecolor() == "white"
