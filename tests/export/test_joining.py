"""Parts of a FusionNet in one graph, against the classifier of the senses that are there."""

import dataclasses
from itertools import combinations

import pytest
import torch
from conftest import make_card

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.export.joining import Part, is_unknown, joined, thresholds
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
    summands = {
        name: torch.randn(3, count if name in there else 0, generator=generator)
        for name, count in zip(SENSES, POSITIONS, strict=True)
    }
    words = draws(7, 40, len(SENSES))
    scores, present = joined([Part.of(each, each, None) for each in summands.values()], words)
    expected = classifier.part(there).join([summands[name] for name in there], 7)
    torch.testing.assert_close(scores, expected)
    assert present.tolist() == [name in there for name in SENSES]


@pytest.mark.parametrize("there", SETS, ids="+".join)
def test_every_set_of_senses_has_its_threshold(classifier, there):
    above = classifier.part(there).card.unknown_above
    assert thresholds(classifier.card)["+".join(there)] == above
    present = torch.tensor([name in there for name in SENSES])
    for novelty in (above, above + 0.01):
        found = is_unknown(classifier.card, torch.tensor(novelty, dtype=torch.float64), present)
        assert bool(found) == (novelty > above)
