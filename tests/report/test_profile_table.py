import csv
from pathlib import Path

import pytest

from tex_lightning.profiling.growth import Point
from tex_lightning.report.figures import save_figure
from tex_lightning.report.paper import paper_table
from tex_lightning.report.profile_figures import growth_figure, layers_figure, ways_figure
from tex_lightning.report.profile_table import left_out, write_growth

POINTS = [
    Point("trace, s", "haptic", "label", 2.0, 4.0, 5.0),
    Point("trace, s", "haptic", "label", 5.0, 9.0, 9.5),
    Point("trace, s", "haptic", "label", 10.0, None, None, "about 9.0 s"),
    Point("trace, s", "haptic", "label", 20.0, None, None, "about 18.0 s"),
    Point("threads", "haptic", "label", 1.0, 4.0, 5.0),
]


def test_the_papers_table_is_the_papers():
    table = paper_table("profiling")
    speedups = {
        name: table[name]["sliding_window_ms"] / table[name]["fcn_ms"]
        for name in ("haptic", "visual")
    }
    assert speedups == pytest.approx({"haptic": 9.53, "visual": 51.2}, rel=1e-3)


def test_growth_is_written_and_read_as_csv(tmp_path):
    write_growth(POINTS, tmp_path / "growth.csv")
    with (tmp_path / "growth.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert rows[1] == {
        "axis": "trace, s",
        "network": "haptic",
        "part": "label",
        "value": "5.0",
        "median_ms": "9.0",
        "p95_ms": "9.5",
        "note": "",
    }
    assert rows[3]["median_ms"] == ""
    assert left_out(POINTS) == ["haptic label against trace, s: left out from 10 on (about 9.0 s)."]


def test_growth_has_a_panel_for_each_axis_and_draws_what_was_measured():
    figure = growth_figure(POINTS)
    shown = [axes for axes in figure.axes if axes.axison]
    assert [axes.get_xlabel() for axes in shown] == ["trace, s", "threads"]
    (line, _) = shown[0].get_lines()
    assert list(line.get_ydata()) == [4.0, 9.0]
    assert shown[0].get_xscale() == shown[0].get_yscale() == "log"


def test_figures_of_a_network_can_be_saved(tmp_path: Path):
    layer = {"name": "trunk.0", "kind": "Conv2d", "ms": 2.0, "macs": 5_000_000}
    network = {
        "sliding_window_ms": 100.0,
        "fcn_ms": 10.0,
        "windows": 11,
        "gemm_gflops": 100.0,
        "layers": [layer, {**layer, "name": "trunk.1"}],
    }
    ways = ways_figure("haptic", network)
    assert [bar.get_width() for bar in ways.axes[0].patches] == [100.0, 10.0, 195.4, 20.5]
    layers = layers_figure("haptic", network)
    assert [bar.get_width() for bar in layers.axes[0].patches] == [2.0, 2.0, 0.1, 0.1]
    sound = ways_figure("sound", network)  # which the paper does not have
    assert [bar.get_width() for bar in sound.axes[0].patches] == [100.0, 10.0]
    for title, figure in (("ways", ways), ("layers", layers)):
        save_figure(figure, tmp_path / title, ["png"])
        assert (tmp_path / f"{title}.png").stat().st_size > 1000
