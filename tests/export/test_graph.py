"""Parts of a FusionNet in one graph, against the classifier of the senses that are there."""

import dataclasses
from itertools import combinations

import numpy as np
import pytest
import torch
from conftest import make_card
from hypothesis import given
from hypothesis import strategies as st
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import RULES
from tex_lightning.data.decode import halve
from tex_lightning.export.graph import Part, PhotoGraph, is_unknown, joined, thresholds, traced_vote
from tex_lightning.export.tracing import draws

SENSES = ("haptic", "visual", "sound")
POSITIONS = (5, 11, 3)
SETS = [each for count in (1, 2, 3) for each in combinations(SENSES, count)]


@pytest.fixture(scope="module")
def classifier():
    card = make_card(*SENSES, width=0.1, pairs=40)
    known = {name: [0.1 * i, 0.2, place] for place, name in enumerate(SENSES) for i in [place + 1]}
    decision, calibration = {**card.decision, "unknown": 0.5}, {"novelties": known}
    return SurfaceClassifier(dataclasses.replace(card, decision=decision, calibration=calibration))


@pytest.mark.parametrize("there", SETS, ids="+".join)
def test_scores_are_those_of_the_part_of_the_senses_that_are_there(classifier, there):
    generator = torch.Generator().manual_seed(0)
    partials = {
        name: torch.randn(3, count if name in there else 0, generator=generator)
        for name, count in zip(SENSES, POSITIONS, strict=True)
    }
    words = draws(7, 40, len(SENSES))
    scores, present = joined([Part.of(each, each, None) for each in partials.values()], words)
    expected = classifier.with_senses(there).fuse([partials[name] for name in there], 7)
    torch.testing.assert_close(scores, expected)
    assert present.tolist() == [name in there for name in SENSES]


@pytest.mark.parametrize("there", SETS, ids="+".join)
def test_every_set_of_senses_has_its_threshold(classifier, there):
    above = classifier.with_senses(there).card.unknown_above
    assert thresholds(classifier.card)["+".join(there)] == above
    present = torch.tensor([name in there for name in SENSES])
    for novelty in (above, above + 0.01):
        found = is_unknown(classifier.card, torch.tensor(novelty, dtype=torch.float64), present)
        assert bool(found) == (novelty > above)


@pytest.mark.parametrize("rule", sorted(RULES))
@given(
    scores=st.lists(st.lists(st.integers(-2, 2), min_size=3, max_size=3), min_size=1, max_size=6),
    temperature=st.sampled_from([0.5, 1.0, 3.0]),
)
def test_label_shares_and_probabilities_are_the_same(rule, scores, temperature):
    logits = torch.tensor(scores).float().T
    expected, found = RULES[rule](logits, temperature), traced_vote(logits, rule, temperature)
    assert int(found.label) == expected.label
    torch.testing.assert_close(found.shares, expected.shares)
    torch.testing.assert_close(found.probabilities, expected.probabilities.float())


@pytest.mark.parametrize("size", [(40, 60), (41, 61), (2, 3)])
def test_halving_is_that_of_the_decoder(size):
    photo = np.random.default_rng(0).integers(256, size=(*size, 3), dtype=np.uint8)
    found = PhotoGraph(nn.Identity(), True, least=2)(torch.from_numpy(photo))
    np.testing.assert_array_equal(found[0].permute(1, 2, 0).numpy(), halve(photo))
