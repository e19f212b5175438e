"""Cross-validation: pooling, resumption, and the sweep that does the same side by side."""

import csv
import json
import re
import shutil
from pathlib import Path

import pytest
import torch

import tex_lightning as tl
from tex_lightning.evaluation.outcomes import read_outcomes, wilson_interval
from tex_lightning.learning.train import Training


def test_chosen_folds_are_run_and_pooled(crossvalidated):
    haptic = json.loads((crossvalidated / "results.json").read_text())["networks"]["haptic"]
    assert [entry["fold"] for entry in haptic["folds"]] == [0, 3]
    assert haptic["test_samples"] == sum(entry["test_samples"] for entry in haptic["folds"]) == 6
    assert haptic["fit_seconds"] == sum(entry["fit_seconds"] for entry in haptic["folds"])
    outcomes = [
        outcome
        for fold in (0, 3)
        for outcome in read_outcomes(crossvalidated / f"folds/{fold}/predictions/haptic.csv")
    ]
    correct = sum(outcome.label == outcome.predicted for outcome in outcomes)
    assert haptic["correct"] == correct
    assert haptic["vote_ci95"] == wilson_interval(correct, 6)
    tested = {Path(outcome.files["haptic"]).stem.rpartition("_")[2] for outcome in outcomes}
    assert tested == {"0", "3"}
    drawn = {
        path.relative_to(crossvalidated).parts[0]
        for path in crossvalidated.rglob("*_confusion.png")
    }
    assert drawn == {"figures"}  # of all folds together, not of each


def test_a_stopped_run_repeats_no_finished_fold(cli, tiny, crossvalidated, tmp_path, monkeypatch):
    directory = shutil.copytree(crossvalidated, tmp_path / "run")
    shutil.rmtree(directory / "folds" / "3")
    (directory / "results.json").unlink()
    trained = []
    original = Training.run
    monkeypatch.setattr(
        Training,
        "run",
        lambda self: trained.append(self.parts.test.rows[0].fold) or original(self),
    )
    arguments = ["task=crossval", "model=haptic", *tiny, f"hydra.run.dir={directory}", "logger=csv"]
    assert cli(*arguments, "crossval.only=[0,2]").status == 0
    assert trained == [2]
    haptic = json.loads((directory / "results.json").read_text())["networks"]["haptic"]
    assert haptic["test_samples"] == 6


def test_folds_of_other_recordings_are_not_pooled(cli, tiny, crossvalidated, tmp_path):
    directory = shutil.copytree(crossvalidated, tmp_path / "run")
    note = json.loads((directory / "recordings.json").read_text())
    (directory / "recordings.json").write_text(json.dumps({**note, "haptic": "of others"}))
    asked = ["task=crossval", "model=haptic", *tiny, f"hydra.run.dir={directory}", "logger=csv"]
    run = cli(*asked, "crossval.only=[0,2]")
    assert run.status == 2
    assert "has begun with other recordings" in run.err
    assert not (directory / "folds" / "2").exists()


def test_after_the_folds_all_recordings_are_trained_on(
    cli, tiny, crossvalidated, surfaces, tmp_path
):
    directory = shutil.copytree(crossvalidated, tmp_path / "run")
    asked = ["task=crossval", "model=haptic", *tiny, f"hydra.run.dir={directory}", "logger=csv"]
    folds = json.loads((directory / "results.json").read_text())["networks"]["haptic"]
    run = cli(*asked, "crossval.only=[0,3]", "crossval.refit=true")
    assert run.status == 0
    assert "2 are tested, one after the other; then all are trained on" in run.err
    results = json.loads((directory / "results.json").read_text())["networks"]["haptic"]
    changed = {key for key in results if results[key] != folds.get(key)}
    assert changed == {"checkpoint", "refit_seconds"}
    card = tl.load(directory).card
    assert len(card.trained_on["seen"]) == 30
    told = {key: folds[key] for key in ("correct", "test_samples", "vote_accuracy", "vote_ci95")}
    assert card.training["crossval"] == {**told, "folds": 2}
    leak = cli("task=evaluate", f"checkpoint={directory}", *tiny[:3], "data.test_fold=3")
    assert leak.status == 2
    assert "has trained on 3 of the 3 test recordings" in leak.err
    before = torch.load(results["checkpoint"], weights_only=True)["state_dict"]
    assert cli(*asked, "crossval.only=[0,3,5]", "crossval.refit=true").status == 0
    again = torch.load(results["checkpoint"], weights_only=True)["state_dict"]
    assert all(torch.equal(before[key], again[key]) for key in before)
    told = tl.load(directory).card.training["crossval"]
    assert (told["folds"], told["test_samples"]) == (3, 9)


def rows(directory: Path) -> list[dict[str, str]]:
    with (directory / "sweep.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_a_sweep_over_folds_pools_them(swept):
    first, second, pooled = rows(swept)
    assert first["status"] == second["status"] == pooled["status"] == "done"
    assert (pooled["job"], int(pooled["test_samples"])) == ("2 folds", 6)
    assert int(pooled["correct"]) == int(first["correct"]) + int(second["correct"])
    report = (swept / "report.md").read_text()
    assert (
        "tex_lightning -m model=mfcc_nb data.test_fold=0,1" in (swept / "report.html").read_text()
    )
    assert re.search(r"\| Modified MFCC decreasing .*\(\d/6\)", report)
    for name in re.findall(r"\]\((figures/[^)]+)\)", report):
        assert (swept / name).read_bytes().startswith(b"\x89PNG")


def test_one_failing_job_does_not_hide_the_others(cli, tiny, tmp_path):
    quick = ["-m", "model=mfcc_nb", *tiny, "logger=csv", f"hydra.sweep.dir={tmp_path}"]
    assert cli(*quick, "data.test_fold=0,77").status == 1
    first, failed = rows(tmp_path)
    assert first["status"] == "done"
    assert "data.test_fold is 77" in failed["status"]
    assert "data.test_fold is 77" in (tmp_path / "1" / "failure.json").read_text()


@pytest.mark.slow
def test_folds_run_side_by_side_through_joblib(cli, tiny, tmp_path):
    # processes of an earlier test would print where that one did
    loky = pytest.importorskip("joblib.externals.loky")
    loky.get_reusable_executor().shutdown()
    launcher = ("hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    folds = ("data.test_fold=0,2", f"hydra.sweep.dir={tmp_path}")
    outcome = cli("-m", "model=haptic", *tiny, *launcher, *folds)
    assert outcome.status == 0, outcome.err
    assert [row["job"] for row in rows(tmp_path)] == ["0", "1", "2 folds"]
    assert "] Job 0: Fold 0, " in outcome.err
    assert "] Job 1: Fold 2, " in outcome.err
