"""What is computed once decides as what is computed for each sample."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
import torch
from conftest import make_card, trunk_node

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.stability.evaluator import REFUSED, Evaluator

MODALITIES = {"haptic": "haptic", "visual": "image", "sound": "sound"}


def untrained(*senses: str, level: str = "fc2") -> SurfaceClassifier:
    torch.manual_seed(0)
    card = make_card(*senses, level=level, pairs=200, width=0.1, trunk=trunk_node("tcnn"))
    classifier = SurfaceClassifier(replace(card, calibration={"temperature": 2.0})).eval()
    if classifier.fusion is not None:
        torch.nn.init.normal_(classifier.fusion.head.weight)
        torch.nn.init.normal_(classifier.fusion.head.bias)
    return classifier


@pytest.fixture(params=["fc2", "fc3"])
def fusion(request) -> SurfaceClassifier:
    return untrained("haptic", "visual", level=request.param)


@pytest.fixture(params=["fc2", "fc3"])
def three(request) -> SurfaceClassifier:
    return untrained("haptic", "visual", "sound", level=request.param)


def recordings(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    trace = rng.standard_normal((1, 24_000)).astype(np.float32)
    photo = rng.integers(0, 256, (240, 260, 3)).astype(np.uint8)
    sound = rng.standard_normal((1, 2 * 44_100)).astype(np.float32)
    return {"haptic": trace, "visual": photo, "sound": sound}


def scored(evaluator, arrays):
    return {sense: evaluator.score(array, sense) for sense, array in arrays.items()}


def same(made, classifier, arrays):
    tensors = {MODALITIES[sense]: torch.from_numpy(array) for sense, array in arrays.items()}
    vote = classifier.classify(**tensors)
    assert made.label == vote.label
    assert made.share == pytest.approx(float(vote.shares[vote.label]))
    assert made.probability == pytest.approx(vote.probability)


def some(arrays, *senses):
    return {sense: arrays[sense] for sense in senses}


def test_together_is_what_classify_gives(fusion):
    evaluator = Evaluator(fusion)
    for haptic, visual in ((0, 0), (0, 1), (1, 0), (1, 1)):
        arrays = {"haptic": recordings(haptic)["haptic"], "visual": recordings(visual)["visual"]}
        same(evaluator.together(scored(evaluator, arrays)), fusion, arrays)


def test_a_single_sense_decides_as_it_does_by_itself():
    classifier = untrained("haptic")
    arrays = some(recordings(0), "haptic")
    evaluator = Evaluator(classifier)
    same(evaluator.together(scored(evaluator, arrays)), classifier, arrays)


def test_alone_is_what_the_part_gives(fusion):
    evaluator = Evaluator(fusion)
    for sense in ("haptic", "visual"):
        arrays = some(recordings(0), sense)
        scores = scored(evaluator, arrays)
        same(evaluator.alone(scores[sense]), fusion.part([sense]), arrays)
        assert evaluator.together(scores) == evaluator.alone(scores[sense])


def test_of_three_senses_any_decide_as_the_part_of_them(three):
    evaluator = Evaluator(three)
    arrays = recordings(0)
    scores = scored(evaluator, arrays)
    for count in (1, 2, 3):
        for senses in combinations(arrays, count):
            made = evaluator.together({sense: scores[sense] for sense in senses})
            same(made, three.part(senses), some(arrays, *senses))


def test_so_many_tuples_are_drawn_as_are_asked_for(fusion):
    evaluator = Evaluator(fusion)
    scores = scored(evaluator, some(recordings(0), "haptic", "visual"))
    assert evaluator.together(scores, 1).share == 1
    assert evaluator.together(scores, 200) == evaluator.together(scores)


def test_agreement_is_the_chance_of_the_same_class(three):
    evaluator = Evaluator(three)
    scores = scored(evaluator, recordings(0))
    beliefs = [each.scores.double().softmax(dim=0).mean(dim=1) for each in scores.values()]
    products = [float((one * other).sum()) for one, other in combinations(beliefs, 2)]
    assert evaluator.together(scores).agreement == pytest.approx(np.mean(products))
    two = {sense: scores[sense] for sense in ("haptic", "visual")}
    assert evaluator.together(two).agreement == pytest.approx(products[0])
    assert evaluator.alone(scores["haptic"]).agreement is None


def test_what_is_too_small_is_refused_and_not_guessed(fusion):
    evaluator = Evaluator(fusion)
    arrays = recordings(0)
    short = evaluator.score(arrays["haptic"][:, :9000], "haptic")
    small = evaluator.score(arrays["visual"][:50], "visual")
    assert short is None
    assert small is None
    photo = evaluator.score(arrays["visual"], "visual")
    assert evaluator.together({"haptic": short, "visual": photo}) == REFUSED
    assert evaluator.alone(small) == REFUSED
