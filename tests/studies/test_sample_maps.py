"""Which test samples are drawn."""

import json
from types import SimpleNamespace

from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.studies.sample_maps import draw_worst, worst_samples


def outcome(label: str, predicted: str, share: float, probability: float) -> Outcome:
    probabilities = json.dumps({predicted: probability})
    return Outcome({}, label, predicted, share, 1, 1, 1.0, probabilities=probabilities)


def test_the_most_confident_wrong_ones_come_first_else_the_least_confident():
    outcomes = [
        outcome("a", "b", 0.5, 0.5), outcome("a", "a", 1.0, 1.0), outcome("a", "b", 1.0, 0.7),
        outcome("b", "a", 1.0, 0.9),
    ]  # fmt: skip
    assert worst_samples(outcomes, 3) == [3, 2, 0]
    assert worst_samples(outcomes, 1) == [3]
    correct = [outcome("a", "a", share, 0.5) for share in (0.9, 0.4, 0.8)]
    assert worst_samples(correct, 3) == [1]
    assert worst_samples(correct, 0) == worst_samples(outcomes, 0) == []


def test_what_an_earlier_test_drew_goes(tmp_path):
    older = tmp_path / "figures" / "haptic_why_2.png"
    older.parent.mkdir()
    older.touch()
    classifier = SimpleNamespace(card=SimpleNamespace(kind="haptic", baseline={}))
    config = SimpleNamespace(explained_samples=0)
    draw_worst(classifier, [], [outcome("a", "b", 1.0, 0.9)], None, config, tmp_path)
    assert not older.exists()
