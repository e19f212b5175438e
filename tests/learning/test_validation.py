"""Validation in training: whole samples, decided many at once."""

from collections.abc import Iterator

import pytest
import torch
from conftest import make_card, make_photo, make_trace

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.learning import validation as module
from tex_lightning.learning.validation import Validation
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

ENGINE = EngineConfig(fast=True, tile=None)
SAMPLES = [
    {
        "haptic": torch.from_numpy(make_trace(label, number))[None],
        "image": torch.from_numpy(make_photo(label, number)),
    }
    for label in range(3)
    for number in range(2)
]
LABELS = torch.tensor([0, 0, 1, 1, 2, 2])


def classifier(*senses: str) -> SurfaceClassifier:
    torch.manual_seed(0)
    return SurfaceClassifier(make_card(*senses, width=0.1)).eval()


def spoilt(model: SurfaceClassifier) -> SurfaceClassifier:
    with torch.no_grad():
        next(model.senses["haptic"].network.parameters()).fill_(torch.nan)
    return model


def epoch(validation: Validation, model: SurfaceClassifier) -> Iterator[torch.Tensor]:
    """Yield decided above true classes, of fragments and of samples."""
    validation.begin(model)
    for number, (sample, label) in enumerate(zip(SAMPLES, LABELS, strict=True)):
        validation.add(sample, label, number)
        if validation.is_full:
            yield from validation.decide()
    if validation.scores:
        yield from validation.decide()


@pytest.mark.parametrize("limit", [1, 1 << 24])
@pytest.mark.parametrize("senses", [("haptic",), ("haptic", "visual")])
@torch.inference_mode()
def test_decisions_are_those_of_every_sample_by_itself(monkeypatch, senses, limit):
    monkeypatch.setattr(module, "MAX_UNDECIDED", limit)
    model = classifier(*senses)
    fragments, samples = [], []
    for sample, label in zip(SAMPLES, LABELS, strict=True):
        given = {name: sample[name] for name in model.card.modalities}
        vote = model.classify(**given)
        fragments.append(torch.stack([vote.fragments, label.expand_as(vote.fragments)]))
        samples.append(torch.stack([torch.tensor(vote.label), label])[:, None])
    found = [*epoch(Validation(), model)]
    assert len(found) == 2 * (len(SAMPLES) if limit == 1 else 1)
    assert torch.equal(torch.cat(found[0::2], dim=1), torch.cat(fragments, dim=1))
    assert torch.equal(torch.cat(found[1::2], dim=1), torch.cat(samples, dim=1))


@torch.inference_mode()
def test_scores_that_are_not_finite_are_errors():
    fragments, samples = epoch(Validation(ENGINE), spoilt(classifier("haptic", "visual")))
    assert fragments.shape == samples.shape == (2, len(SAMPLES))
    assert (fragments[0] != fragments[1]).all()
    assert (samples[0] != samples[1]).all()


@pytest.mark.parametrize("limit", [0, 1 << 28])
@torch.inference_mode()
def test_inputs_of_signals_are_computed_once_and_weights_are_those_of_the_epoch(monkeypatch, limit):
    monkeypatch.setattr(module, "MAX_INPUTS", limit)
    computed, forward = [], SpectrogramFeatures.forward
    monkeypatch.setattr(
        SpectrogramFeatures, "forward", lambda self, x: computed.append(1) or forward(self, x)
    )
    validation, model = Validation(ENGINE), classifier("haptic", "visual")
    for number in range(2):
        found = [*epoch(validation, model)]
        assert len(computed) == len(SAMPLES) * (1 if limit else number + 1)
        computed_anew = [*epoch(Validation(ENGINE), model)]
        del computed[-len(SAMPLES) :]
        for one, other in zip(found, computed_anew, strict=True):
            assert torch.equal(one, other)
        with torch.no_grad():  # as a step of training does
            for weight in model.parameters():
                weight.add_(0.1 * torch.randn_like(weight))
