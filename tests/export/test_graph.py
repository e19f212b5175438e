"""The graph of an exported file, against the classifier."""

from typing import Any, get_type_hints

import numpy as np
import pytest
import torch
from conftest import SHORT_WINDOWS, make_card
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

import tex_lightning as tl
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import RULES
from tex_lightning.config import DecisionConfig
from tex_lightning.config.keys import Key
from tex_lightning.errors import UserError
from tex_lightning.export.graph import TRACED, PhotoGraph, fused_scores, traced_vote
from tex_lightning.export.metadata import metadata
from tex_lightning.export.onnx_file import noise_sample
from tex_lightning.export.tracing import draws
from tex_lightning.export.tracing import trace as traced
from tex_lightning_runtime import Runtime
from tex_lightning_runtime.pixels import halve


def test_scores_of_several_senses_are_those_of_the_classifier():
    classifier = SurfaceClassifier(make_card("haptic", "visual", "sound", width=0.1, pairs=40))
    generator = torch.Generator().manual_seed(0)
    partials = [torch.randn(3, count, generator=generator) for count in (5, 11, 3)]
    scores = fused_scores(partials, draws(7, 40, 3))
    torch.testing.assert_close(scores, classifier.fuse(partials, 7))


@pytest.mark.parametrize("rule", sorted(RULES))
@given(
    scores=st.lists(st.lists(st.integers(-2, 2), min_size=3, max_size=3), min_size=1, max_size=6),
    temperature=st.sampled_from([0.5, 1.0, 3.0]),
)
def test_label_shares_and_probabilities_are_the_same(rule, scores, temperature):
    logits = torch.tensor(scores).float().T
    expected, found = RULES[rule](logits, temperature), traced_vote(logits, rule, temperature)
    assert int(found["label"]) == expected.label
    torch.testing.assert_close(found["shares"], expected.shares)
    torch.testing.assert_close(found["probabilities"], expected.probabilities.float())


@pytest.mark.parametrize("size", [(40, 60), (41, 61), (2, 3)])
def test_halving_is_that_of_the_decoder(size):
    photo = np.random.default_rng(0).integers(256, size=(*size, 3), dtype=np.uint8)
    found = PhotoGraph(nn.Identity(), True, least=2)(torch.from_numpy(photo))
    np.testing.assert_array_equal(found[0].permute(1, 2, 0).numpy(), halve(photo))


def test_a_rule_can_be_chosen_decides_and_has_a_form_in_exported_files():
    known = Key.of(get_type_hints(DecisionConfig, include_extras=True)["rule"]).choices
    assert set(known) == set(RULES) == set(TRACED)
    with pytest.raises(
        UserError, match=r"decision\.rule=other has no form in exported files; give"
    ):
        traced_vote(torch.zeros(2, 3), "other", 1.0)


def slow_signals(axes: int) -> tuple[tl.Estimator, list[np.ndarray], np.ndarray]:
    """A model of signals of so many axes whose levels count, and what it was fitted to."""
    rng, time, labels = np.random.default_rng(0), np.arange(300) / 100, np.arange(12) % 2
    waves = [np.sin(2 * np.pi * (5 + 15 * label) * time) for label in labels]
    traces = [(wave + 0.5 * rng.standard_normal((axes, 300))).astype(np.float32) for wave in waves]
    model = tl.Estimator("few/haptic", rate=100, **SHORT_WINDOWS)
    return model.fit(traces, labels), traces, labels


@pytest.mark.parametrize("axes", [3, 6])
def test_an_export_is_compared_on_noise_of_as_many_axes_as_have_levels(axes):
    classifier = slow_signals(axes)[0].predictor_.classifier
    (said,), features = metadata(classifier)["senses"], classifier.senses["haptic"].features
    assert (said["axes"], said["least"]) == ([axes], features.min_samples)
    for seed in range(4):
        sample = noise_sample(classifier, seed)
        assert len(sample["haptic"]) == axes
        assert len(classifier.partial_logits("haptic", sample["haptic"])) == 2


def test_an_export_is_compared_on_noise_as_strong_as_the_training():
    card = make_card("haptic", width=0.1)
    card.input_ranges["haptic"] = {"level": [1e-10, 3e-10]}
    classifier = SurfaceClassifier(card)
    assert noise_sample(classifier, 0)["haptic"].std() == pytest.approx(3e-10, rel=0.1)


def test_signals_of_any_number_of_axes_are_taken_where_levels_do_not_count():
    (sense,) = metadata(SurfaceClassifier(make_card("haptic", width=0.1)))["senses"]
    assert sense["axes"] == [*range(1, 65)]


def test_a_traced_model_takes_the_bands_of_all_windows_in_use():
    model, (trace, *_), _ = slow_signals(3)
    classifier = model.predictor_.classifier
    program, *_ = traced(classifier)
    signal = torch.from_numpy(trace)
    found = program.module()(haptic=signal)["scores"]
    torch.testing.assert_close(found, classifier.logits(haptic=signal), atol=1e-4, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("axes", [3, 6])
def test_a_slow_signal_decides_alike_after_an_export_at_any_gain(axes, tmp_path):
    model, traces, labels = slow_signals(axes)
    scores: Any = model.predictor_.classifier.senses["haptic"].network.head.scores
    assert scores.gainless.in_use
    model.export(tmp_path)
    (file,) = tmp_path.glob("*.onnx")
    runtime = Runtime(file, threads=1)
    for label, trace in list(zip(labels, traces, strict=True))[:2]:
        for gain in (0.02, 0.4, 1, 50):
            expected = model.predictor_.predict(haptic=gain * trace)
            found = runtime.predict(haptic=gain * trace)
            assert found["label"] == expected.label == str(label)
            assert found["confidence"] == pytest.approx(expected.confidence, abs=1e-4)
    for silent in (trace * np.eye(axes)[:, :1].astype(np.float32), 0 * trace):
        expected, found = model.predictor_.predict(haptic=silent), runtime.predict(haptic=silent)
        assert found["warnings"] == [*expected.warnings]
        assert found["probabilities"] == pytest.approx(expected.probabilities, abs=1e-4)
    short = trace[:, : runtime.senses["haptic"]["least"] - 1]
    with pytest.raises(UserError, match="less movement than the"):
        runtime.predict(haptic=short)
    assert runtime.stream().push(short)["label"] is None


@pytest.mark.slow
def test_a_signal_unlike_all_in_training_decides_alike_after_an_export(tmp_path):
    rng, labels = np.random.default_rng(0), np.arange(12) % 3
    time = np.arange(1000) / 1000
    waves = [np.sin(2 * np.pi * (60 + 90 * label) * time) for label in labels]
    traces = [(wave + 0.5 * rng.standard_normal(1000)).astype(np.float32) for wave in waves]
    model = tl.Estimator("few/haptic", rate=1000, **SHORT_WINDOWS).fit(traces, labels)
    other = (traces[0] + 0.3 * np.sign(rng.standard_normal(1000))).cumsum().astype(np.float32)
    expected = model.predictor_.predict(haptic=other)
    model.export(tmp_path)
    (file,) = tmp_path.glob("*.onnx")
    found = Runtime(file, threads=1).predict(haptic=other)
    assert found["label"] == expected.label
    assert found["confidence"] == pytest.approx(expected.confidence, abs=1e-4)
    classifier, signal = model.predictor_.classifier, torch.from_numpy(other)[None]
    moved = classifier.logits(haptic=signal)
    within: Any = classifier.senses["haptic"].network
    within.head.scores.range.take(None)
    assert not torch.allclose(classifier.logits(haptic=signal), moved, atol=1e-2)
