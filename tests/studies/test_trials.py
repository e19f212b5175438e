"""Bisection, flips and summaries on a system whose behaviour is known."""

import re
from dataclasses import dataclass, field

import pytest

from tex_lightning.errors import UserError
from tex_lightning.perturbations.table import Perturbation
from tex_lightning.studies.perturbed import REFUSED, Decision
from tex_lightning.studies.trials import Bench, Record, corruption_error, mean_errors

NOISE = Perturbation("white_noise", "haptic", "dB", (0, 1, 2, 3, 4, 5))


@dataclass
class Stub:
    """Classes a and b with ten samples each; those of b go one by one, the last is refused."""

    name: str = "stub"
    kind: str = "haptic"
    breaks_at: float = 3.3
    asked: list = field(default_factory=list)

    labels = ["a"] * 10 + ["b"] * 10
    wanted = [0] * 10 + [1] * 10

    def clean(self):
        return [Decision(label, 1.0, 0.9) for label in self.wanted]

    def decide(self, perturbation, severity):
        self.asked.append(severity)
        lost = 10 if severity >= self.breaks_at else 0
        made = self.clean()
        made[10 : 10 + lost] = [Decision(0, 1.0, 0.6)] * (lost - 1) + [REFUSED] * (lost > 0)
        return made

    def meets(self, perturbation):
        return True


def test_the_breaking_point_is_bisected_to_the_stated_width(tmp_path):
    system = Stub()
    bench = Bench([system], Record(tmp_path / "trials.jsonl"))
    found = bench.breaking_point(system, NOISE, 0.8, 5)
    assert found.clean == 1
    assert found.least == pytest.approx(0.8)
    assert 3.3 <= found.below.severity <= 3.3 + 1 / 32
    assert found.classes == ["b"]
    assert len(system.asked) == len(set(system.asked))


def test_a_stopped_search_goes_on_without_what_is_done(tmp_path):
    record, whole = tmp_path / "trials.jsonl", Stub()
    first = list(Bench([whole], Record(record)).grid([NOISE]))
    record.write_text(record.read_text()[:-40])  # stopped while the last was written
    again = Stub()
    second = list(Bench([again], Record(record)).grid([NOISE]))
    assert again.asked == [5]
    assert [trial.decisions for trial in second] == [trial.decisions for trial in first]


def test_what_does_not_break_says_so(tmp_path):
    system = Stub(breaks_at=9)
    found = Bench([system], Record(tmp_path / "trials.jsonl")).breaking_point(system, NOISE, 0.8, 5)
    assert found.below is None


def test_accuracy_flips_refusals_and_probabilities(tmp_path):
    system = Stub()
    trials = list(Bench([system], Record(tmp_path / "trials.jsonl")).grid([NOISE]))
    assert [trial.severity for trial in trials] == [0, 1, 2, 3, 4, 5]
    clean, broken = trials[0], trials[-1]
    assert (clean.accuracy, clean.flip_rate, clean.refused) == (1, 0, 0)
    assert (broken.accuracy, broken.flip_rate, broken.refused) == (0.5, 0.5, 1)
    assert broken.probability_when(False) == pytest.approx(0.6)
    assert clean.probability_when(False) is None
    assert broken.class_accuracy() == {"a": 1, "b": 0}
    assert mean_errors(trials) == {"white_noise": pytest.approx(0.2)}


def test_corruption_error_is_the_mean_ratio_where_the_reference_errs():
    reference = {"x": 0.5, "y": 0.2, "z": 0.0}
    found = corruption_error({"x": 0.25, "y": 0.4, "z": 0.3, "w": 1.0}, reference)
    assert found == {"mean": pytest.approx((0.5 + 2.0) / 2), "perturbations": 2}
    assert corruption_error({"z": 0.3}, reference) is None


def test_a_line_that_was_cut_off_is_left_out(tmp_path):
    record, decision = Record(tmp_path / "trials.jsonl"), Decision(0, 0.5)
    record.add(("a", "noise", 1.0), [decision])
    whole = record.path.read_bytes()
    record.path.write_bytes(whole + whole[:20])
    assert Record(record.path).trials == {("a", "noise", 1.0): [decision]}
    assert record.path.read_bytes() == whole


KEY = ("haptic", "noise", 3.0)
MADE = [Decision(2, 0.5)]


def test_finished_trials_are_read_again_and_a_line_cut_off_is_not(tmp_path):
    path = tmp_path / "trials.jsonl"
    Record(path).add(KEY, MADE)
    with path.open("a") as stream:
        stream.write('["haptic", "noise", 4.0')
    assert Record(path).trials == {KEY: MADE}
    assert len(path.read_text().splitlines()) == 1


@pytest.mark.parametrize(
    "line", ["{", "[1, 2]", "3", '["haptic", "noise", 4.0, [[1, 2, 3, 4, 5, 6]]]']
)
def test_a_damaged_line_is_named(tmp_path, line):
    path = tmp_path / "trials.jsonl"
    Record(path).add(KEY, MADE)
    with path.open("a") as stream:
        stream.write(line + "\n")
    with pytest.raises(UserError, match=re.escape(f"Line 2 of {path} is damaged")):
        Record(path)
