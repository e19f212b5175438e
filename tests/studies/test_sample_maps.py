"""Which test samples are drawn."""

import json
from types import SimpleNamespace

from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.page_media import map_folder
from tex_lightning.studies.sample_maps import draw_telling, telling


def outcome(label: str, predicted: str, share: float, probability: float) -> Outcome:
    probabilities = json.dumps({predicted: probability})
    return Outcome({}, label, predicted, share, 1, 1, 1.0, probabilities=probabilities)


def test_the_surest_of_the_wrong_come_first():
    outcomes = [
        outcome("a", "b", 0.5, 0.5), outcome("a", "a", 1.0, 1.0), outcome("a", "b", 1.0, 0.7),
        outcome("b", "a", 1.0, 0.9),
    ]  # fmt: skip
    assert telling(outcomes, 3) == [3, 2, 0]
    assert telling(outcomes, 1) == [3]
    assert telling(outcomes, 0) == []


def test_if_none_is_wrong_it_is_the_least_sure_one():
    outcomes = [outcome("a", "a", share, 0.5) for share in (0.9, 0.4, 0.8)]
    assert telling(outcomes, 3) == [1]
    assert telling(outcomes, 0) == []


def test_without_samples_to_explain_nothing_is_drawn_and_what_was_goes(tmp_path):
    older = map_folder(tmp_path, "haptic") / "0" / "haptic" / "haptic.png"
    for path in (older, tmp_path / "figures" / "haptic_why_2.png"):
        path.parent.mkdir(parents=True)
        path.write_bytes(b"of another test")
    classifier = SimpleNamespace(card=SimpleNamespace(kind="haptic", baseline={}))
    config = SimpleNamespace(explained_samples=0)
    outcomes = [outcome("a", "b", 1.0, 0.9)]
    assert draw_telling(classifier, [], outcomes, None, config, tmp_path) == {}
    assert not [*tmp_path.rglob("*.png")]
