"""The chart of ``task=profile``, and the paper's figures in it."""

import pytest

from tex_lightning.report.figures import save_figure
from tex_lightning.report.profile_table import ways_figure
from tex_lightning.report.table import paper_table


def test_the_papers_table_is_the_papers():
    table = paper_table("profiling")
    speedups = {
        name: table[name]["sliding_window_ms"] / table[name]["fcn_ms"]
        for name in ("haptic", "visual")
    }
    assert speedups == pytest.approx({"haptic": 9.53, "visual": 51.2}, rel=1e-3)


def test_the_chart_has_both_ways_beside_the_papers(tmp_path):
    network = {"sliding_window_ms": 100.0, "fcn_ms": 10.0, "windows": 11}
    ways = ways_figure("haptic", network)
    assert [bar.get_width() for bar in ways.axes[0].patches] == [100.0, 10.0, 195.4, 20.5]
    sound = ways_figure("sound", network)  # which the paper does not have
    assert [bar.get_width() for bar in sound.axes[0].patches] == [100.0, 10.0]
    save_figure(ways, tmp_path / "ways")
    assert (tmp_path / "ways.png").stat().st_size > 1000
