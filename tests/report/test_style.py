"""Systems of a chart look different, and the caller's own settings of Matplotlib stay."""

import matplotlib

from tex_lightning.report.style import STYLE, looks, styled


def test_a_chart_draws_no_two_systems_alike():
    found = looks([str(number) for number in range(40)])
    assert len({(look.colour, look.marker) for look in found.values()}) == 40


def test_the_callers_settings_stay(monkeypatch):
    monkeypatch.setitem(matplotlib.rcParams, "font.size", 33)
    size = styled(lambda: matplotlib.rcParams["font.size"])()
    assert (size, matplotlib.rcParams["font.size"]) == (STYLE["font.size"], 33)
