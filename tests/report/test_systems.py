"""Systems of any senses side by side."""

import json
from pathlib import Path
from typing import Any

import pytest

from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes
from tex_lightning.report.systems import (
    NOTES,
    ReportedSystem,
    _against,
    accuracy_table,
    read_systems,
)

ENTRY = {"fit_seconds": 1.0, "parameters": 7}


def make(kind: str, correct: str, *modalities: str, **changes: Any) -> ReportedSystem:
    """A system and the numbers of the samples that it classified correctly, as + and -."""
    outcomes = [
        Outcome({name: f"{n}.{name}" for name in modalities}, "a", "ba"[mark == "+"], 1, 1, 1, 2.0)
        for n, mark in enumerate(correct)
    ]
    settings = {"model": kind, "inside": "", "data": "folder", "variant": "", **changes}
    return ReportedSystem(
        kind=kind, entries=[ENTRY], outcomes=outcomes, **{"classes": ["a", "b"], **settings}
    )


@pytest.mark.parametrize("data", ["tum", "folder"])
def test_the_papers_columns_stand_beside_its_own_data_alone(data):
    table = accuracy_table("haptic", [make("haptic", "++-", "haptic", data=data)])
    assert (table.rows[0]["system"], table.rows[0]["accuracy"]) == ("HapticNet", "66.7% (2/3)")
    assert ("accuracy, paper" in table.headings) == ("paper" in table.text) == (data == "tum")
    assert table.rows[0]["accuracy, paper"] == ("91 %" if data == "tum" else "")


def test_a_sweep_over_data_says_how_many_classes_each_has():
    two, four = make("haptic", "++", "haptic"), make("haptic", "+-", "haptic", classes=[*"abcd"])
    said = accuracy_table("haptic", [four, two]).text
    assert said == "Data: folder, 2 classes (chance 50.0%) or 4 classes (chance 25.0%)."


def test_a_sense_that_the_paper_does_not_have_gets_a_table_of_its_own():
    part = make("haptic", "+--", "haptic", inside="fusion_sum")
    assert part.label == "haptic inside fusion_sum"  # which need not be HapticNet
    table = accuracy_table("force", [make("force", "+--", "force", inside="fusion", data="tum")])
    assert table.title == "Force classification"
    assert table.rows[0]["system"] == "force inside fusion"
    assert "accuracy, paper" not in table.headings


def test_a_system_of_fewer_senses_is_compared_on_its_part_of_each_sample():
    fused = make("fusion", "+++-", "haptic", "image", "sound")
    part = make("fusion", "+--+", "haptic", "sound")
    assert _against(fused, part) == "1 (2:1)"
    assert _against(part, fused) == "-"  # the part has no sample of all senses


def finish(folder: Path, **settings: Any) -> None:
    entry = {"fit_seconds": 1.0, "vote_accuracy": 1.0, "parameters": 7}
    results = {"model": "haptic", "data": "folder", "classes": ["a"], "networks": {"haptic": entry}}
    outcome = Outcome({"haptic": folder.name}, "a", "a", 1, 1, 1, 2.0)
    write_outcomes([outcome], folder / "predictions" / "haptic.csv")
    (folder / "results.json").write_text(json.dumps(results))
    (folder / "settings.json").write_text(json.dumps(settings))


def test_runs_of_several_folds_are_one_system_and_other_settings_another(tmp_path):
    for name, fold, rate in (("a", 0, 500), ("b", 1, 500), ("c", 0, 900)):
        given = {"data.test_fold": fold, "data.rate": rate, "model.haptic.decode.rate": rate}
        finish(tmp_path / name, **given)
    systems = read_systems([tmp_path / name for name in "abc"])
    assert {each.variant: len(each.outcomes) for each in systems} == {
        "data.rate=500": 2,
        "data.rate=900": 1,
    }


def test_runs_that_test_the_same_samples_count_once(tmp_path):
    counts = {"speed": {"60": {"correct": 1, "test_samples": 1}}}
    for name, fold, seed in (("a", 1, 0), ("b", 2, 0), ("c", 1, 1)):  # each tests its one sample
        finish(tmp_path / name / "same", **{"data.val_fold": fold, "seed": seed})
        results = json.loads((tmp_path / name / "same" / "results.json").read_text())
        results["networks"]["haptic"]["conditions"] = counts
        (tmp_path / name / "same" / "results.json").write_text(json.dumps(results))
    (system,) = read_systems([tmp_path / name / "same" for name in "abc"])
    assert (len(system.outcomes), len(system.entries), system.seeds) == (1, 2, [1.0, 1.0])
    assert system.conditions["conditions"]["speed"]["60"]["test_samples"] == 1


def test_parts_of_a_fusion_are_systems_inside_it(fused):
    systems = {system.kind: system for system in read_systems([fused])}
    inside = {kind: system.inside for kind, system in systems.items()}
    assert inside == {"haptic": "fusion", "visual": "fusion", "fusion": ""}
    outcomes = read_outcomes(fused / "predictions" / "haptic.csv")
    assert systems["haptic"].outcomes == outcomes


def test_runs_that_test_conditions_are_pooled_as_unseen(tmp_path):
    for name, speed in (("a", 40), ("b", 60)):
        finish(tmp_path / name, **{"data.test_where.speed": speed})
    (system,) = read_systems([tmp_path / "a", tmp_path / "b"])
    assert (system.label, len(system.outcomes)) == ("HapticNet (unseen speed)", 2)


def test_no_row_is_called_best_and_seeds_are_not_compared_by_one_of_them():
    one, other = make("haptic", "++-", "haptic"), make("minirocket", "+--", "haptic")
    cells = [row["p against the top"] for row in accuracy_table("haptic", [one, other]).rows]
    assert cells == ["top", "1 (1:0)"]
    seeds = make("acnn", "+--", "haptic", seeds=[0.1, 0.2])
    rows = accuracy_table("haptic", [one, seeds]).rows
    assert {row["p against the top"] for row in rows} == {"top", "-"}
    assert ["fragments" in row for row in rows] == [False, True]
    assert "best" not in NOTES
