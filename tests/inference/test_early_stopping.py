"""Sequential decisions against the full ones, and that what they leave out is not computed."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import make_card
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.classifier.vote import RULES
from tex_lightning.config import DecisionConfig
from tex_lightning.errors import UserError
from tex_lightning.inference.early_stopping import make_decider
from tex_lightning.inference.engine import empty_classifier, input_macs
from tex_lightning.inference.prediction import make_prediction
from tex_lightning_runtime.quality import Quality

NEVER = 1.0
SENSES = {
    "haptic": ["haptic"],
    "visual": ["visual"],
    "fusion": ["haptic", "visual"],
    "three": ["haptic", "visual", "sound"],
}
CONFIG = DecisionConfig(
    name="sequential",
    pairs=200,
    seed=0,
    confidence_threshold=NEVER,
)


def classifier(kind: str, level: str = "fc2") -> SurfaceClassifier:
    torch.manual_seed(0)
    given = {"width": 0.1, "scale": "linear"}  # mel bands are a product that would be counted
    card = make_card(*SENSES[kind], classes=["a", "b", "c", "d"], level=level, pairs=200, **given)
    model = SurfaceClassifier(card)
    for module in model.modules():
        if isinstance(module, nn.Conv2d | nn.Linear) and len(module.weight) == 4:
            nn.init.normal_(module.weight, std=0.3)
    return model.eval().requires_grad_(False)


def trace(seed: int, seconds: float = 6.0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.standard_normal((1, int(seconds * 10_000))).astype(np.float32))


def photo(seed: int, height: int = 800, width: int = 1000) -> torch.Tensor:
    """Noise of another coarseness and colour in every quarter, so that windows differ."""
    rng = np.random.default_rng(seed)
    parts = [rng.integers(0, 60 + 190 * rng.random(), (2, 2, 3)) for _ in range(1)]
    coarse = np.kron(parts[0], np.ones((height // 2, width // 2, 1)))
    return torch.from_numpy((coarse / 2 + rng.integers(0, 128, coarse.shape)).astype(np.uint8))


def sound(seed: int, seconds: float = 6.0) -> torch.Tensor:
    rng = np.random.default_rng([seed, 1])
    return torch.from_numpy(rng.standard_normal((1, int(seconds * 44_100))).astype(np.float32))


def given(kind: str, seed: int) -> dict[str, torch.Tensor]:
    """A sample, as far as these networks look at it."""
    make = {"haptic": trace, "visual": photo, "sound": sound}
    names = {"haptic": "haptic", "visual": "image", "sound": "sound"}
    return {names[sense]: make[sense](seed) for sense in SENSES[kind]}


def spent(function) -> int:
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        function()
    return counter.get_total_flops() // 2


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_costs_known_in_advance_are_those_of_the_pass(level):
    model = classifier("three", level)
    empty = empty_classifier(model.card)
    inputs = given("three", 0)
    sizes = {"visual": (800, 1000)}
    for name in ("haptic", "sound"):
        sizes[name] = 50, model.senses[name].features.count_frames(inputs[name])
    total = sum(input_macs(empty, name, *size) for name, size in sizes.items())
    assert total == spent(lambda: model.logits(**inputs))
    for name, size in sizes.items():  # where the other senses are absent
        alone, modality = model.with_senses([name]), model.senses[name].modality
        found = input_macs(empty.with_senses([name]), name, *size)
        assert found == spent(lambda alone=alone, it=modality: alone.logits(**{it: inputs[it]}))


@pytest.mark.parametrize("threshold", [0.0, NEVER])
def test_a_trace_costs_its_beginnings_and_the_whole_where_they_do_not_decide(threshold):
    model = classifier("haptic")
    sequential = make_decider(model, replace(CONFIG, confidence_threshold=threshold))
    long = trace(0, 20.0)
    vote, whole = (each.classify(haptic=long) for each in (sequential, model))  # counts costs
    counted, full = (
        spent(lambda each=each: each.classify(haptic=long)) for each in (sequential, model)
    )
    assert vote.relative_macs == pytest.approx(counted / full)
    if threshold == NEVER:
        assert torch.equal(vote.fragments, whole.fragments)
        assert 1 < vote.relative_macs < 1.5
    else:
        beginning = model.classify(haptic=long[:, : 176 * 100 + 500])
        assert torch.equal(vote.fragments, beginning.fragments)
        assert len(vote.fragments) == 1
        assert vote.relative_macs < 0.15


def count_positions(monkeypatch, network: nn.Module) -> list[int]:
    """Rows of batches that pass the network's trunk."""
    rows: list[int] = []
    network.trunk.register_forward_hook(lambda _, x, __: rows.append(len(x[0])))
    return rows


def test_fusion_looks_at_the_photo_only_where_the_trace_is_not_enough(monkeypatch):
    model = classifier("fusion")
    rows = count_positions(monkeypatch, model.senses["visual"].network)
    quick = make_decider(model, replace(CONFIG, confidence_threshold=0.0))
    vote = quick.classify(**given("fusion", 0))
    assert rows == []
    assert 0 < vote.relative_macs < 1
    make_decider(model, CONFIG).classify(**given("fusion", 0))
    assert rows


@pytest.mark.parametrize(
    ("kind", "level", "rule"),
    [
        ("haptic", "fc2", "score"),
        ("visual", "fc2", "mean"),
        ("three", "fc3", "vote"),
        *(("three", "fc2", rule) for rule in RULES),
    ],
)
def test_the_decision_is_the_full_one_if_nothing_is_sure(kind, level, rule):
    model = classifier(kind, level)
    model.card = replace(model.card, decision={**model.card.decision, "rule": rule})
    vote, full = (m.classify(**given(kind, 0)) for m in (make_decider(model, CONFIG), model))
    assert vote.label == full.label
    assert torch.equal(vote.fragments.bincount(), full.fragments.bincount())
    torch.testing.assert_close(vote.probabilities, full.probabilities)


def telling_unknown(kind: str, limits: dict[str, float]) -> SurfaceClassifier:
    """A classifier with statistics, and the novelty of all its known samples by sense."""
    model = classifier(kind)
    for name, sense in model.senses.items():
        size = len(model.embedding(name, given(kind, 1)[sense.modality]))
        rows = torch.rand(12, size, generator=torch.Generator().manual_seed(0))
        model.statistics[name] = FeatureStatistics.of(rows, torch.arange(12) % 4, 4)
    novelties = {name: [limit] * 30 for name, limit in limits.items()}
    decision = {**model.card.decision, "unknown": 0.1}
    model.card = replace(model.card, decision=decision, calibration={"novelties": novelties})
    return model


NOTHING, ALL = 0.0, 9.0  # what is known of a sense: no recording to come, or every one


@pytest.mark.parametrize(
    ("haptic", "visual", "modalities", "rejected"),
    [
        (ALL, ALL, ("haptic",), False),
        (ALL, NOTHING, ("haptic",), False),
        (NOTHING, NOTHING, ("haptic", "image"), True),
        (NOTHING, ALL, ("haptic", "image"), False),
    ],
)
def test_a_fusion_says_unknown_of_all_senses_only(haptic, visual, modalities, rejected):
    model = telling_unknown("fusion", {"haptic": haptic, "visual": visual})
    quick = make_decider(model, replace(CONFIG, confidence_threshold=0.0))
    vote, full = (each.classify(**given("fusion", 0)) for each in (quick, model))
    assert (vote.modalities or model.card.modalities) == modalities
    prediction = make_prediction(vote, model.card, Quality(), 1, 0.0)
    assert prediction.rejected is rejected
    assert (prediction.label == "unknown") is rejected
    assert vote.novelty == (full.novelty if len(modalities) == 2 else None)
    assert (vote.relative_macs < 1) == (len(modalities) == 1)


@pytest.mark.parametrize(("limit", "whole"), [(NOTHING, True), (ALL, False)])
def test_a_trace_is_called_unknown_by_its_whole_only(limit, whole):
    model, long = telling_unknown("haptic", {"haptic": limit}), trace(0, 20.0)
    vote = make_decider(model, replace(CONFIG, confidence_threshold=0.0)).classify(haptic=long)
    full = model.classify(haptic=long)
    assert (vote.novelty == full.novelty, len(vote.fragments) == len(full.fragments)) == (
        whole,
        whole,
    )
    assert make_prediction(vote, model.card, Quality(), 1, 0.0).rejected is whole


def test_a_baseline_is_refused():
    model = classifier("haptic")
    model.card = replace(model.card, baseline={"name": "rocket"})
    with pytest.raises(UserError, match="rocket looks at the whole recording"):
        make_decider(model, CONFIG)
    assert make_decider(model, replace(CONFIG, name="max_vote")) is model
