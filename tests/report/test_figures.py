"""Inputs of any sense, drawn."""

import pytest
import torch
from conftest import make_card
from torch import nn

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.evaluation.fragments import ConfusedPair
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.features.spectrogram import SpectrogramFeatures
from tex_lightning.report.confused_pairs import pairs_figure
from tex_lightning.report.figures import spectrogram_figure


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


@pytest.mark.parametrize("senses", [("haptic", "visual"), ("visual", "sound", "haptic")])
def test_a_pair_shows_what_each_sense_took_of_both_classes(senses, surfaces):
    branches = SurfaceClassifier(make_card(*senses, width=0.1)).branches.values()
    outcomes = [
        Outcome(
            {
                "haptic": str(surfaces / label / "haptic" / f"{label}_0.wav"),
                "image": str(surfaces / label / "image" / f"{label}_0.png"),
                "sound": str(surfaces / label / "haptic" / f"{label}_1.wav"),
            },
            label, label, 1.0, 1, 1, 1.0,
        )
        for label in ("alpha", "beta")
    ]  # fmt: skip
    pair = ConfusedPair(("alpha", "beta"), "visual", 0.5, "haptic", 0.1)
    figure = pairs_figure([pair], outcomes, branches)
    assert len(figure.axes) == 2 * len(senses)
    assert figure.axes[0].get_ylabel() == "confused by visual\n(50%, haptic 10%)"
    titles = [axes.get_title() for axes in figure.axes]
    assert [title for title in titles if title] == ["alpha", "beta"]
    assert all(axes.get_images()[0].get_array().std() > 0 for axes in figure.axes)
