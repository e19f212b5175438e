"""Recordings of a sample put together wrongly, and who meets that."""

from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_card, trunk_node

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.perturbations.table import perturbations
from tex_lightning.studies.perturbed import (
    REFUSED,
    Decision,
    Evaluator,
    Member,
    PerturbedDataset,
    System,
)

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
            made[modality] = Recording(label, modality, path, group, fold=group)
        return made

    def system(senses: dict[str, str]) -> System:
        modalities = dict.fromkeys(senses.values())
        samples = [Sample(label, rows(label, group, modalities)) for label in LABELS
                   for group in (0, 1)]  # fmt: skip
        dataset = PerturbedDataset(Whole(), seed=0)
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
        same(evaluator.alone(scores[sense]), fusion.with_senses([sense]), arrays)
        assert evaluator.together(scores) == evaluator.alone(scores[sense])


def test_of_three_senses_any_decide_as_the_part_of_them(three):
    evaluator = Evaluator(three)
    arrays = recordings(0)
    scores = scored(evaluator, arrays)
    for count in (1, 2, 3):
        for senses in combinations(arrays, count):
            made = evaluator.together({sense: scores[sense] for sense in senses})
            same(made, three.with_senses(senses), some(arrays, *senses))


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
