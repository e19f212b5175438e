"""Tracing a classifier, and random words for the tuples of a FusionNet."""

import pytest
import torch
from conftest import make_card

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import random_tuples
from tex_lightning.errors import UserError
from tex_lightning.export.onnx_file import compare, noise_sample
from tex_lightning.export.tracing import draws, trace
from tex_lightning.networks.hapticnet import HapticNet


def test_words_modulo_positions_are_the_tuples_of_pytorchs_generator():
    positions = (7, 1, 1234)
    words = draws(seed=2**32 - 5, count=300, senses=3)
    assert torch.equal(words % torch.tensor(positions), random_tuples(positions, 300, 2**32 - 5))


def test_python_that_depends_on_values_cannot_be_traced(monkeypatch, capsys):
    classifier = SurfaceClassifier(make_card("haptic", width=0.1)).eval()
    monkeypatch.setattr(HapticNet, "features", lambda self, x, level: x * (1 if x.sum() > 0 else 2))
    with pytest.raises(UserError, match=r"\(SpectrogramFeatures, HapticNet\) cannot be exported"):
        trace(classifier)
    assert capsys.readouterr().err == ""  # PyTorch prints hundreds of lines of its graph


def test_a_file_that_runs_for_one_length_alone_is_a_sentence():
    def runner(inputs):
        raise RuntimeError("Non-zero status code returned while running Reshape node")

    classifier = SurfaceClassifier(make_card("haptic", width=0.1)).eval()
    with pytest.raises(UserError, match=r"HapticNet\) cannot be exported: RuntimeError: Non-zero"):
        compare(runner, classifier, [noise_sample(classifier, 0)])
