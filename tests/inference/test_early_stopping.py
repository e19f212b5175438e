"""Sequential decisions against the full ones, and that what they leave out is not computed."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import trunk_node
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import DecisionConfig
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.errors import UserError
from tex_lightning.inference.costs import Costs
from tex_lightning.inference.early_stopping import SequentialClassifier, decide
from tex_lightning.parts import part_for

NEVER = 1.0
CONFIG = DecisionConfig(
    name="sequential",
    pairs=200,
    seed=0,
    alpha=0.0,
    confidence_threshold=NEVER,
    calibrated=True,
    disagreement=0.1,
    confidence=0.95,
    alphas=[],
    confidence_thresholds=[],
)


def classifier(kind: str, level: str = "fc2", **calibration: float) -> SurfaceClassifier:
    torch.manual_seed(0)
    network = {"width": 0.1, "norm": "batch", "dropout": 0.5}
    card = Card(
        kind=kind,
        classes=["a", "b", "c", "d"],
        decode=DecodeSettings().to_dict(),
        decision={"pairs": 200, "seed": 0},
        haptic_features={} if kind == "visual" else {"axes": "frame", "normalisation": "standard"},
        haptic_network={} if kind == "visual" else network,
        visual_network={}
        if kind == "haptic"
        else {**network, "trunk": trunk_node("alexnet_caffe")},
        fusion={"level": level} if kind == "fusion" else {},
        calibration=calibration,
    )
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


def given(kind: str, seed: int) -> dict[str, torch.Tensor]:
    inputs = {"trace": trace(seed), "photo": photo(seed)}
    return {"haptic": {"trace": inputs["trace"]}, "visual": {"photo": inputs["photo"]}}.get(
        kind, inputs
    )


def spent(function) -> int:
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        function()
    return counter.get_total_flops() // 2


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_costs_known_in_advance_are_those_of_the_pass(level):
    model = classifier("fusion", level)
    costs = Costs(model.card)
    inputs = given("fusion", 0)
    frames = model.haptic_features.count_frames(inputs["trace"])
    assert costs.haptic(frames) + costs.visual(800, 1000) == spent(lambda: model.logits(**inputs))


@pytest.mark.parametrize("seed", range(3))
def test_a_trace_is_taken_only_as_far_as_the_exact_vote_needs(seed):
    model = classifier("haptic")
    vote = SequentialClassifier(model, CONFIG).classify(trace(seed, 12.0))
    full = model.classify(trace(seed, 12.0))
    assert vote.label == full.label
    assert len(vote.fragments) <= len(full.fragments)
    if vote.relative_macs > 1:
        assert len(vote.fragments) == len(full.fragments)


def test_the_rest_of_a_trace_is_neither_transformed_nor_run(monkeypatch):
    model = classifier("haptic")
    sequential = SequentialClassifier(model, replace(CONFIG, confidence_threshold=0.0))
    seen = []
    original = model.haptic_features.spectra
    monkeypatch.setattr(
        model.haptic_features, "spectra", lambda x: seen.append(x.shape[1]) or original(x)
    )
    vote = sequential.classify(trace(0, 12.0))  # which also counts what it will cost
    counted = spent(lambda: sequential.classify(trace(0, 12.0)))
    assert len(vote.fragments) == 1
    overlap = 500 - 100  # samples that two pieces share
    assert sum(seen) == 2 * (176 * 100 + 500 + overlap)
    full = spent(lambda: model.classify(trace(0, 12.0)))
    assert vote.relative_macs * full == pytest.approx(counted)
    assert vote.relative_macs < 0.25


@pytest.mark.parametrize("kind", ["haptic", "fusion"])
def test_a_short_trace_is_taken_whole_at_once(kind, monkeypatch):
    model = classifier(kind)
    sequential = SequentialClassifier(model, CONFIG)
    pushed = []
    monkeypatch.setattr(sequential.stream, "push", pushed.append)
    short = {"trace": trace(0, 3.0), **({"photo": photo(0)} if kind == "fusion" else {})}
    vote = sequential.classify(**short)
    assert pushed == []
    assert vote.label == model.classify(**short).label
    if kind == "haptic":
        assert vote.relative_macs == 1.0


def test_an_undecided_trace_costs_few_pushes_and_one_pass(monkeypatch):
    model = classifier("haptic")
    sequential = SequentialClassifier(model, CONFIG)
    pushes, push = [], sequential.stream.push
    monkeypatch.setattr(sequential.stream, "push", lambda x: pushes.append(x.shape[1]) or push(x))
    vote = sequential.classify(trace(0, 20.0))
    assert len(vote.fragments) == len(model.classify(trace(0, 20.0)).fragments) == 114
    assert 1 <= len(pushes) <= 6
    assert 1 < vote.relative_macs < 1.5


def count_positions(monkeypatch, network: nn.Module) -> list[int]:
    """Rows of batches that pass the network's trunk."""
    rows: list[int] = []
    network.trunk.register_forward_hook(lambda _, x, __: rows.append(len(x[0])))
    return rows


@pytest.mark.parametrize("alpha", [0.0, 0.2])
def test_windows_not_drawn_are_not_computed(monkeypatch, alpha):
    model = classifier("visual")
    model.network.head.score_layer.bias.copy_(torch.tensor([0.0, 50.0, 0.0, 0.0]))
    sequential = SequentialClassifier(model, replace(CONFIG, alpha=alpha))
    large = photo(0, 1400, 1600)
    rows = count_positions(monkeypatch, model.network)
    vote = sequential.classify(photo=large)
    assert vote.label == 1
    if alpha == 0:  # more than half of the positions: the dense pass is cheaper
        assert rows == [1]
        assert vote.relative_macs == 1
        assert len(vote.fragments) == model.logits(photo=large).shape[1]
    else:
        assert sum(rows) == len(vote.fragments) == sequential.rule.least_more([0] * 4, 10_000)
        counted = spent(lambda: sequential.classify(photo=large))
        full = spent(lambda: model.classify(photo=large))
        assert vote.relative_macs == pytest.approx(counted / full)
        assert vote.relative_macs < 0.3


def test_single_windows_have_the_scores_of_isolated_crops():
    model = classifier("visual")
    large = photo(1)
    sequential = SequentialClassifier(model, CONFIG)
    rows, columns = model.network.output_size(800, 1000)
    last = rows * columns - 1
    scores = sequential._windows(large, torch.tensor([columns + 2, last]))
    inside = model.logits(photo=large[32 : 32 + 224, 64 : 64 + 224].contiguous())
    edge = model.logits(photo=large[-224:, -224:].contiguous())
    torch.testing.assert_close(scores, torch.cat((inside, edge), dim=1))


@pytest.mark.parametrize(("kind", "level"), [("visual", ""), ("fusion", "fc2"), ("fusion", "fc3")])
def test_the_dense_fallback_is_the_full_vote(kind, level):
    model = classifier(kind, level)
    sequential = SequentialClassifier(model, CONFIG)
    for seed in range(3):
        vote, full = (m.classify(**given(kind, seed)) for m in (sequential, model))
        assert vote.label == full.label
        assert torch.equal(
            vote.fragments.bincount(minlength=4), full.fragments.bincount(minlength=4)
        )


def test_fusion_looks_at_the_photo_only_where_the_trace_is_not_enough(monkeypatch):
    model = classifier("fusion", confidence_threshold=0.0)
    rows = count_positions(monkeypatch, model.network.visual)
    vote = SequentialClassifier(model, CONFIG).classify(**given("fusion", 0))
    assert rows == []
    assert 0 < vote.relative_macs < 1
    unsure = SequentialClassifier(model, replace(CONFIG, calibrated=False))
    assert unsure.threshold == NEVER
    unsure.classify(**given("fusion", 0))
    assert rows


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_fusion_takes_no_more_of_a_trace_than_it_needs(level):
    model = classifier("fusion", level)
    long = {"trace": trace(0, 20.0), "photo": photo(0, 1400, 1600)}
    whole = Costs(model.card)
    haptic = whole.haptic(model.haptic_features.count_frames(long["trace"]))
    share = haptic / (haptic + whole.visual(1400, 1600))
    sure = SequentialClassifier(model, replace(CONFIG, confidence_threshold=0.0)).classify(**long)
    assert sure.relative_macs < 0.3 * share
    beginning = part_for(model, "haptic").classify(trace(0, 3.0))
    assert sure.label == beginning.label


def test_the_cheaper_modality_comes_first(monkeypatch):
    model = classifier("fusion", confidence_threshold=0.0)
    small = photo(0, 240, 240)
    rows = count_positions(monkeypatch, model.network.haptic)
    vote = SequentialClassifier(model, CONFIG).classify(trace(0, 60.0), small)
    assert rows == []
    assert vote.relative_macs < 0.5


def test_fusion_draws_the_pairs_of_the_full_vote():
    model = classifier("fusion")
    model.network.head.weight.mul_(0.01)
    model.network.head.bias.copy_(torch.tensor([0.0, 0.0, 5.0, 0.0]))
    large = {"trace": trace(0), "photo": photo(0, 1400, 1600)}
    vote = SequentialClassifier(model, replace(CONFIG, alpha=0.2)).classify(**large)
    assert vote.label == model.classify(**large).label == 2
    assert len(vote.fragments) < 20
    assert vote.relative_macs < 0.5


def test_a_mean_of_probabilities_is_refused():
    model = classifier("haptic")
    model.card = replace(model.card, decision={**model.card.decision, "rule": "mean"})
    with pytest.raises(UserError, match="counts votes"):
        decide(model, CONFIG)


def test_a_baseline_is_refused():
    model = classifier("haptic")
    model.card = replace(model.card, baseline={"name": "rocket"})
    with pytest.raises(UserError, match="rocket looks at the whole recording"):
        decide(model, CONFIG)
    assert decide(model, replace(CONFIG, name="max_vote")) is model
