"""What must not change a decision, and input on the edge of what numbers can hold."""

import numpy as np
import pytest
import torch
from conftest import make_card, trunk_node
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import RULES
from tex_lightning.config import EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning_runtime.samples import content_seed

ENGINE = EngineConfig(fast=True, tile=None)
SENSES = {"haptic": ["haptic"], "visual": ["visual"], "fusion": ["haptic", "visual"]}


def classifier(kind: str, normalisation: str = "standard", pairs: int = 200) -> SurfaceClassifier:
    """Random weights whose class scores differ enough to be told apart."""
    torch.manual_seed(0)
    card = make_card(
        *SENSES[kind], classes=["a", "b", "c", "d"], pairs=pairs, width=0.1, axes="frame",
        scale="linear", normalisation=normalisation, skip_impact=False, trunk=trunk_node("tcnn"),
    )  # fmt: skip
    model = SurfaceClassifier(card).eval().requires_grad_(False)
    for module in model.modules():
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.normal_(module.weight, std=2 / module.weight[0].numel() ** 0.5)
    return model


def noise(seconds: float = 3.0, seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.standard_normal((1, round(seconds * 10_000))).astype(np.float32))


def photo(seed: int = 0) -> torch.Tensor:
    rng = np.random.default_rng(seed)
    return torch.from_numpy(rng.integers(0, 256, (280, 300, 3)).astype(np.uint8))


def test_the_number_of_threads_does_not_matter():
    model = accelerate(classifier("fusion"), ENGINE)
    threads, votes, scores = torch.get_num_threads(), [], []
    try:
        for count in (1, 2):
            torch.set_num_threads(count)
            votes.append(model.classify(haptic=noise(), image=photo()))
            scores.append(model.logits(haptic=noise(), image=photo()))
    finally:
        torch.set_num_threads(threads)
    assert len({vote.label for vote in votes}) == 1
    torch.testing.assert_close(*scores, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize("seed", [0, 1, 2**32 - 1])
def test_random_pairs_estimate_the_vote_of_all_pairs(seed):
    count = 4000
    model = classifier("fusion", pairs=count)
    halves = [model.partial_logits("haptic", noise()), model.partial_logits("visual", photo())]
    every = (halves[0][:, :, None] + halves[1][:, None, :]).flatten(1)
    exact = torch.bincount(every.argmax(dim=0), minlength=4) / every.shape[1]
    share = RULES["vote"](model.fuse(halves, seed)).shares
    spread = (exact * (1 - exact) / count).sqrt()
    assert ((share - exact).abs() <= 4.5 * spread + 1e-6).all()


def test_seeds_of_pairs_depend_on_every_byte():
    trace, image = noise().numpy(), photo().numpy()
    seed = content_seed(0, trace, image)
    assert seed == content_seed(0, trace[:, ::1].copy(), np.asfortranarray(image))
    changed = image.copy()
    changed[5, 5, 1] ^= 1
    assert len({seed, content_seed(1, trace, image), content_seed(0, trace, changed)}) == 3


EDGES = {
    "silent": np.zeros(30_000),
    "constant": np.full(30_000, 7.0),
    "denormal": np.random.default_rng(0).standard_normal(30_000) * 1e-40,
    "large": np.random.default_rng(0).standard_normal(30_000) * 1e8,
    "one impulse": np.eye(1, 30_000, 15_000)[0],
}
UNUSABLE = {
    "not a number": np.where(np.arange(30_000) == 15_000, np.nan, 0.1),
    "infinite": np.where(np.arange(30_000) == 15_000, np.inf, 0.1),
    "overflowing": np.random.default_rng(0).standard_normal(30_000) * 1e30,
}


@pytest.mark.parametrize("normalisation", ["standard", "paper"])
@pytest.mark.parametrize("edge", EDGES)
def test_input_at_the_edge_ends_in_a_label(edge, normalisation):
    model = classifier("haptic", normalisation)
    scores = model.logits(haptic=torch.from_numpy(EDGES[edge].astype(np.float32))[None])
    assert scores.isfinite().all()
    assert RULES["vote"](scores).shares.sum() == pytest.approx(1)


@pytest.mark.parametrize("normalisation", ["standard", "paper"])
@pytest.mark.parametrize("edge", UNUSABLE)
def test_input_without_a_spectrum_ends_in_a_sentence(edge, normalisation):
    model = classifier("haptic", normalisation)
    with pytest.raises(UserError, match="NaN, infinity or numbers too large"):
        model.classify(haptic=torch.from_numpy(UNUSABLE[edge].astype(np.float32))[None])


def test_one_sample_too_few_is_refused_and_one_more_is_not():
    model = classifier("haptic")
    features = model.senses["haptic"].features
    least = (HapticNet.min_size[1] - 1) * features.hop_length + features.window_length
    assert model.logits(haptic=noise()[:, :least]).shape == (4, 1)
    with pytest.raises(UserError, match="experiment=few/haptic"):
        model.logits(haptic=noise()[:, : least - 1])
