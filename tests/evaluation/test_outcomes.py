import json
import subprocess
from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import accuracy_score, confusion_matrix

from tex_lightning.evaluation.outcomes import (
    Outcome,
    environment,
    read_outcomes,
    summarise,
    vote_counts,
    wilson_interval,
    worst_first,
    write_outcomes,
    write_results,
)

CLASSES = ["a", "b", "c"]
LABELS = st.lists(st.tuples(st.sampled_from(CLASSES), st.sampled_from(CLASSES)), min_size=1)


def outcome(label: str, predicted: str, fragments: int = 4, right: int = 2) -> Outcome:
    files = {"haptic": "x.wav", "sound": "y.wav"}
    return Outcome(files, label, predicted, 0.5, fragments, right, 1.5)


def test_a_sample_is_named_alike_whichever_sense_comes_first():
    one, other = {"haptic": "x.wav", "image": "y.png"}, {"image": "y.png", "haptic": "x.wav"}
    samples = {Outcome(files, "a", "a", 0.5, 4, 2, 1.5).sample for files in (one, other)}
    assert len(samples) == 1


def test_the_worst_are_wrong_and_sure_the_best_right_and_sure():
    def made(label: str, probabilities: dict[str, float], share: float = 0.5) -> Outcome:
        best = max(probabilities, key=probabilities.__getitem__, default="b")
        return Outcome({}, label, best, share, 1, 1, 1.0, probabilities=json.dumps(probabilities))

    order = [
        made("a", {"a": 0.0, "b": 1.0}), made("a", {"a": 0.4, "b": 0.5, "c": 0.1}),
        made("a", {}, 0.9), made("a", {}, 0.4),  # of a system without probabilities
        made("b", {}, 0.3), made("b", {"b": 0.5, "a": 0.45, "c": 0.05}), made("a", {"a": 1.0}),
    ]  # fmt: skip
    assert worst_first(order) == [*range(7)]
    assert worst_first(order[::-1]) == [*range(6, -1, -1)]


@given(LABELS)
def test_summary_and_confusion_agree_with_scikit_learn(pairs):
    outcomes = [outcome(*pair) for pair in pairs]
    labels, predicted = zip(*pairs, strict=True)
    summary = summarise(outcomes)
    assert summary["vote_accuracy"] == pytest.approx(accuracy_score(labels, predicted))
    theirs = confusion_matrix(labels, predicted, labels=CLASSES)
    np.testing.assert_array_equal(vote_counts(outcomes, CLASSES), theirs)


@pytest.mark.parametrize(
    ("correct", "low", "high"), [(682, 0.977, 0.994), (679, 0.972, 0.991), (628, 0.886, 0.929)]
)
def test_wilson_intervals_of_the_papers_690_pairs(correct, low, high):
    """98.8 %, 98.4 % and 91.0 % of 690, as tabulated with three decimals elsewhere."""
    assert wilson_interval(correct, 690) == pytest.approx([low, high], abs=6e-4)


@pytest.mark.parametrize("correct", [0, 12])
def test_intervals_at_the_ends_stay_inside(correct):
    low, high = wilson_interval(correct, 12)
    assert 0 <= low < high <= 1
    z = 1.959964
    edge = z**2 / (12 + z**2)  # closed form for none or all of 12
    assert (high if correct == 0 else 1 - low) == pytest.approx(edge, rel=1e-5)


def test_fragments_are_pooled_over_samples():
    summary = summarise([outcome("a", "a", 10, 9), outcome("b", "a", 30, 3)])
    assert summary["fragment_accuracy"] == 12 / 40
    assert summary["latency_ms"] == {"median": 1.5, "p95": 1.5}


def test_outcomes_survive_a_round_trip(tmp_path):
    outcomes = [outcome("a", "b"), outcome('c,"x"', "ü")]
    outcomes = [replace(each, novelty=place / 4) for place, each in enumerate(outcomes)]
    write_outcomes(outcomes, tmp_path / "sub" / "o.csv")
    assert read_outcomes(tmp_path / "sub" / "o.csv") == outcomes


def test_outcomes_of_very_many_classes_survive_it_too(tmp_path):
    known = json.dumps({f"a material with a long name {number}": 1 / 7 for number in range(4000)})
    outcome = Outcome({"haptic": "a"}, "a", "b", 1.0, 1, 0, 1.0, probabilities=known)
    write_outcomes([outcome], tmp_path / "predictions.csv")
    assert read_outcomes(tmp_path / "predictions.csv")[0].probabilities == known


def test_results_are_whole_or_not_there(tmp_path):
    path = tmp_path / "results.json"
    write_results(path, {"a": 1})
    with pytest.raises(TypeError):
        write_results(path, {"a": object()})
    assert json.loads(path.read_text()) == {"a": 1}
    assert [item.name for item in tmp_path.iterdir()] == ["results.json"]


def test_the_environment_says_what_matters():
    found = environment(torch.device("cpu"))
    assert found["versions"]["torch"] == torch.__version__
    assert found["threads"] == torch.get_num_threads()
    assert found["device"] == "cpu"
    json.dumps(found)


def test_the_environment_names_the_commit_of_a_checkout_alone(tmp_path, monkeypatch):
    def git(*arguments: str) -> str:
        who = ("-c", "user.name=a", "-c", "user.email=b")
        command = ["git", "-C", str(tmp_path), *who, *arguments]
        return subprocess.run(command, check=True, capture_output=True, text=True).stdout

    def commit() -> str | None:
        return environment(torch.device("cpu"))["commit"]

    module = tmp_path / "package" / "evaluation" / "outcomes.py"
    monkeypatch.setattr("tex_lightning.evaluation.outcomes.__file__", str(module))
    assert commit() is None
    git("init", "-q")
    (tmp_path / "a").write_text("one")
    git("add", "a")
    git("commit", "-qm", "first")
    assert git("rev-parse", "HEAD").startswith(commit())
    (tmp_path / "a").write_text("two")
    assert commit().endswith("-dirty")
