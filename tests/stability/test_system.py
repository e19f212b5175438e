"""Recordings of a sample put together wrongly, and who meets that."""

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pytest

from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.perturbations.table import perturbations
from tex_lightning.stability.evaluator import REFUSED, Decision
from tex_lightning.stability.perturbed import PerturbedDataset
from tex_lightning.stability.system import Member, System

TABLE = perturbations()
TWO = {"haptic": "haptic", "visual": "image"}
THREE = {**TWO, "sound": "sound"}
LABELS = ("a", "b", "c")


@dataclass
class Stub:
    """An evaluator that says what it was asked to decide on."""

    modalities: dict[str, str]
    asked: list = field(default_factory=list)

    def score(self, recording, sense):
        return recording

    def together(self, scores, count=None):
        self.asked.append((scores, count))
        return REFUSED if None in scores.values() else Decision(0)


class Whole:
    """A store whose recordings are their file names."""

    def load(self, row):
        return row.path.name


@pytest.fixture
def make(tmp_path):
    def rows(label: str, group: int, modalities) -> dict[str, Recording]:
        made = {}
        for modality in modalities:
            path = tmp_path / f"{label}_{group}.{modality}"
            path.write_text(path.name)
            made[modality] = Recording(label, modality, path, group)
        return made

    def system(senses: dict[str, str]) -> System:
        modalities = dict.fromkeys(senses.values())
        samples = [Sample(label, rows(label, group, modalities)) for label in LABELS
                   for group in (0, 1)]  # fmt: skip
        dataset = PerturbedDataset(Whole(), seed=0, folds=2)
        dataset.add(row for sample in samples for row in sample.recordings.values())
        kind = "fusion" if len(senses) > 1 else next(iter(senses))
        return System("mine", kind, [Member(Path("x"), Stub(senses), samples, dataset)])

    return system


def names(system: System) -> set[str]:
    return {each.name for each in TABLE.values() if each.modality == "both" and system.meets(each)}


def test_a_system_meets_what_hits_a_modality_that_it_reads_beside_another(make):
    assert names(make({"haptic": "haptic"})) == set()
    pairs = {"haptic_missing", "image_missing", "haptic_swapped", "image_swapped", "fewer_pairs"}
    assert names(make(TWO)) == pairs
    assert names(make(THREE)) == {*pairs, "sound_missing", "sound_swapped"}
    assert names(make({"one": "image", "other": "image"})) == set()


def test_the_remaining_senses_decide_together(make):
    system = make(THREE)
    system.decide(TABLE["image_missing"], 5)
    asked = system.members[0].evaluator.asked
    assert asked[0] == ({"haptic": "a_0.haptic", "sound": "a_0.sound"}, None)
    assert all(scores.keys() == {"haptic", "sound"} for scores, _ in asked)


def test_a_swapped_recording_is_of_another_class_and_the_same_fold(make):
    system = make(THREE)
    system.decide(TABLE["sound_swapped"], 5)
    for (scores, _), (_, sample) in zip(
        system.members[0].evaluator.asked, system.samples, strict=True
    ):
        swapped, group = scores["sound"].removesuffix(".sound").split("_")
        assert swapped != sample.label
        assert group == str(sample.recordings["sound"].group)
        assert scores["visual"] == sample.recordings["image"].path.name
        assert list(scores) == ["haptic", "visual", "sound"]


@pytest.mark.parametrize("senses", [TWO, THREE])
def test_it_happens_to_a_share_that_the_files_decide(make, senses):
    system, table = make(senses), TABLE["haptic_missing"]
    system.decide(table, 2)
    (member,) = system.members
    for (scores, _), sample in zip(member.evaluator.asked, member.samples, strict=True):
        chance = member.dataset.rng(table.name, *sample.recordings.values()).random()
        assert ("haptic" in scores) == (chance >= table.value(2))
    again = make(senses)
    again.decide(table, 2)
    assert again.members[0].evaluator.asked == member.evaluator.asked


def test_fewer_pairs_are_counted(make):
    system = make(TWO)
    system.decide(TABLE["fewer_pairs"], 3)
    assert {count for _, count in system.members[0].evaluator.asked} == {10}


def test_the_draws_of_a_sample_are_those_of_its_content(make):
    (one,), (other,) = make(TWO).members, make(TWO).members
    rows = [list(member.samples[0].recordings.values()) for member in (one, other)]
    draws = [member.dataset.rng("x", *each).random(3) for member, each in zip((one, other), rows,
             strict=True)]  # fmt: skip
    assert np.array_equal(*draws)
    assert not np.array_equal(draws[0], one.dataset.rng("y", *rows[0]).random(3))


def test_parts_of_one_file_are_recordings_of_their_own(make, tmp_path):
    dataset = make({"haptic": "haptic"}).members[0].dataset
    whole = dataset.rows[str(tmp_path / "a_0.haptic")]
    halves = [replace(whole, part=part) for part in ((0, 0.5), (0.5, 1))]
    before = len(dataset.rows)
    dataset.add(halves)
    assert len(dataset.rows) == before + 2
    drawn = {dataset.rng("noise", row).integers(1 << 62) for row in (whole, *halves)}
    assert len(drawn) == 3
