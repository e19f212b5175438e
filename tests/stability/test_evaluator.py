"""What is computed once decides as what is computed for each sample."""

import numpy as np
import pytest
import torch

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.parts import part_for
from tex_lightning.stability.evaluator import REFUSED, Evaluator

NETWORK = {"width": 0.1, "norm": "batch", "dropout": 0.5}


@pytest.fixture(params=["fc2", "fc3"])
def fusion(request) -> SurfaceClassifier:
    torch.manual_seed(0)
    card = Card(
        kind="fusion",
        classes=["a", "b", "c"],
        decode=DecodeSettings().to_dict(),
        decision={"pairs": 200, "seed": 3},
        haptic_features={"axes": "frame", "scale": "mel"},
        haptic_network=NETWORK,
        visual_network={**NETWORK, "trunk": "tcnn"},
        fusion={"level": request.param},
    )
    classifier = SurfaceClassifier(card).eval()
    torch.nn.init.normal_(classifier.network.head.weight)
    return classifier


def recordings(seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    trace = rng.standard_normal((1, 24_000)).astype(np.float32)
    return trace, rng.integers(0, 256, (240, 260, 3)).astype(np.uint8)


def test_together_is_what_classify_gives(fusion):
    evaluator = Evaluator(fusion)
    for haptic in (0, 1):
        for image in (0, 1):
            trace, photo = recordings(haptic)[0], recordings(image)[1]
            scores = evaluator.score(trace, "haptic"), evaluator.score(photo, "image")
            made = evaluator.together(*scores)
            vote = fusion.classify(torch.from_numpy(trace), torch.from_numpy(photo))
            assert made.label == vote.label
            assert made.share == pytest.approx(float(vote.shares[vote.label]))


def test_alone_is_what_the_part_gives(fusion):
    evaluator = Evaluator(fusion)
    trace, photo = recordings(0)
    vote = part_for(fusion, "haptic").classify(torch.from_numpy(trace))
    made = evaluator.alone(evaluator.score(trace, "haptic"))
    assert (made.label, made.share) == (vote.label, pytest.approx(float(vote.shares.max())))
    vote = part_for(fusion, "image").classify(photo=torch.from_numpy(photo))
    made = evaluator.alone(evaluator.score(photo, "image"))
    assert (made.label, made.share) == (vote.label, pytest.approx(float(vote.shares.max())))


def test_agreement_is_the_chance_of_the_same_class(fusion):
    evaluator = Evaluator(fusion)
    scores = [
        evaluator.score(array, modality)
        for array, modality in zip(recordings(0), ("haptic", "image"), strict=True)
    ]
    beliefs = [scores.scores.double().softmax(dim=0).mean(dim=1) for scores in scores]
    made = evaluator.together(*scores)
    assert made.agreement == pytest.approx(float((beliefs[0] * beliefs[1]).sum()))


def test_what_is_too_small_is_refused_and_not_guessed(fusion):
    evaluator = Evaluator(fusion)
    trace, photo = recordings(0)
    short, small = evaluator.score(trace[:, :9000], "haptic"), evaluator.score(photo[:50], "image")
    assert short is None
    assert small is None
    assert evaluator.together(short, evaluator.score(photo, "image")) == REFUSED
    assert evaluator.alone(small) == REFUSED
