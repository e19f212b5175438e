"""Inputs of any sense, drawn."""

import pytest
import torch
from torch import nn

from tex_lightning.report.figures import save_figure, spectrogram_figure
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


def test_a_figure_is_saved_alike_every_time(tmp_path):
    def saved(folder: str) -> bytes:
        figure = spectrogram_figure(torch.ones(1, 6, 30), ["a"], nn.Identity())
        return save_figure(figure, tmp_path / folder / "w0.5_a").read_bytes()

    assert saved("one") == saved("other")
    assert (tmp_path / "one" / "w0.5_a.png").read_bytes().startswith(b"\x89PNG")
