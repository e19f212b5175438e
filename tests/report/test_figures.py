"""Inputs of any sense, drawn."""

import re

import pytest
import torch
from torch import nn

from tex_lightning.report.figures import picture, save_figure, spectrogram_figure
from tex_lightning.report.page import write_page
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures


def test_a_spectrogram_is_over_seconds_and_hertz():
    features = SpectrogramFeatures(sampling_rate=10_000.0)
    (axes,) = spectrogram_figure(torch.rand(1, 50, 30), ["a"], features).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("s", "Hz")
    assert axes.get_xlim() == pytest.approx((0, 0.3))
    assert [label.get_text() for label in axes.get_yticklabels()][1] == "200"


def test_features_that_tell_no_frequencies_are_numbered():
    (axes,) = spectrogram_figure(torch.rand(1, 6, 30), ["a"], nn.Identity()).axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("frame", "band")
    assert axes.get_xlim() == (-0.5, 29.5)
    assert axes.get_ylim() == (-0.5, 5.5)


def test_a_figure_is_saved_in_all_formats_and_alike_every_time(tmp_path):
    def saved(folder: str) -> list[bytes]:
        figure = spectrogram_figure(torch.ones(1, 6, 30), ["a"], nn.Identity())
        shown = save_figure(figure, tmp_path / folder / "w0.5_a", ["pdf", "svg", "png"])
        assert shown == tmp_path / folder / "w0.5_a.png"
        return [shown.with_suffix(f".{name}").read_bytes() for name in ("png", "pdf", "svg")]

    png, pdf, svg = saved("one")
    assert (png[:4], pdf[:5], svg[:5]) == (b"\x89PNG", b"%PDF-", b"<?xml")
    assert b"/Type3" not in pdf  # which publishers refuse
    assert saved("other") == [png, pdf, svg]


def test_a_page_shows_vector_graphics_and_links_to_what_it_cannot_show(tmp_path):
    figure = spectrogram_figure(torch.ones(1, 6, 30), ["a"], nn.Identity())
    in_report = save_figure(figure, tmp_path / "figures" / "learning", ["pdf"])
    (tmp_path / "report.md").write_text(f"# T\n\n{picture('curves', in_report)}\n")
    save_figure(figure, tmp_path / "figures" / "confusion", ["pdf", "svg"])
    save_figure(figure, tmp_path / "figures" / "accuracy", ["pdf"])
    write_page(tmp_path)
    page = (tmp_path / "report.html").read_text()
    assert page.count("data:image/svg+xml;base64,") == 1
    assert re.findall(r'href="([^"]+)"', page) == ["figures/learning.pdf", "figures/accuracy.pdf"]
