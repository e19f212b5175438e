"""Systems of a chart look different, and the caller's own settings of Matplotlib stay."""

import logging

import matplotlib
from matplotlib.font_manager import get_font_names

from tex_lightning.report.style import FONTS, OTHER_FONTS, STYLE, briefs, looks, styled


def test_a_chart_draws_no_two_systems_alike():
    found = looks([str(number) for number in range(40)])
    assert len({(look.colour, look.marker) for look in found.values()}) == 40


def test_the_callers_settings_stay(monkeypatch):
    monkeypatch.setitem(matplotlib.rcParams, "font.size", 33)
    size = styled(lambda: matplotlib.rcParams["font.size"])()
    assert (size, matplotlib.rcParams["font.size"]) == (STYLE["font.size"], 33)


def test_long_names_that_differ_in_the_middle_differ_when_they_are_brief():
    names = [f"material number {number:02} with a long descriptive name" for number in range(60)]
    found = briefs(["oak", *names], 26)
    assert found[:2] == ["oak", "material numb…00 with a lon"]
    assert len({*found}) == 61


def test_names_in_other_scripts_have_fonts_that_are_here_and_all_else_the_usual_one():
    usual, *others = STYLE["font.family"]
    assert usual == "DejaVu Sans"
    assert {*others} == {*OTHER_FONTS} & {*get_font_names()}


def test_fonts_are_not_warned_of_and_the_callers_warnings_stay(caplog):
    warning = "no usual weight"
    with caplog.at_level(logging.WARNING, FONTS.name):
        styled(FONTS.warning)(warning)
        assert not caplog.messages
        FONTS.warning(warning)
    assert caplog.messages == [warning]
