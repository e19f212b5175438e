"""Cross-validation: pooling, resumption, and the sweep that does the same side by side."""

import csv
import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image
from scipy.stats import binomtest

import tex_lightning as tl
from tex_lightning.evaluation.outcomes import read_outcomes
from tex_lightning.learning import train
from tex_lightning.report.page_media import LEGEND


@pytest.fixture(scope="module")
def directory(crossvalidated, tmp_path_factory) -> Path:
    """The run in another place, where it goes on."""
    return shutil.copytree(crossvalidated, tmp_path_factory.mktemp("moved") / "run")


def test_chosen_folds_are_run_and_pooled(crossvalidated):
    directory = crossvalidated
    assert [path.name for path in directory.rglob("*why*")] == ["haptic_why_1.png"]
    haptic = json.loads((directory / "results.json").read_text())["networks"]["haptic"]
    assert [entry["fold"] for entry in haptic["folds"]] == [0, 3]
    assert haptic["test_samples"] == sum(entry["test_samples"] for entry in haptic["folds"]) == 6
    assert haptic["fit_seconds"] == sum(entry["fit_seconds"] for entry in haptic["folds"])
    outcomes = [
        outcome
        for fold in (0, 3)
        for outcome in read_outcomes(directory / f"folds/{fold}/predictions/haptic.csv")
    ]
    correct = sum(outcome.label == outcome.predicted for outcome in outcomes)
    assert haptic["correct"] == correct
    interval = binomtest(correct, 6).proportion_ci(method="wilson")
    assert haptic["vote_ci95"] == pytest.approx([interval.low, interval.high])
    tested = {Path(outcome.files["haptic"]).stem.rpartition("_")[2] for outcome in outcomes}
    assert tested == {"0", "3"}
    drawn = {path.relative_to(directory).parts[0] for path in directory.rglob("*_confusion.png")}
    assert drawn == {"figures"}  # of all folds together, not of each
    assert not (directory / "tensorboard").exists()


def test_a_stopped_and_moved_run_repeats_no_finished_fold(cli, tiny, directory, monkeypatch):
    shutil.rmtree(directory / "folds" / "3")
    (directory / "results.json").unlink()
    trained = []
    original = train.train_network
    monkeypatch.setattr(
        "tex_lightning.studies.fold.train_network",
        lambda *given: trained.append(given[2].test.rows[0].group) or original(*given),
    )
    arguments = ["task=crossval", "model=haptic", *tiny, f"hydra.run.dir={directory}", "logger=csv"]
    assert cli(*arguments, "explained_samples=1", "crossval.only=[0,2,3]").status == 0
    assert trained == [2, 3]
    haptic = json.loads((directory / "results.json").read_text())["networks"]["haptic"]
    assert haptic["test_samples"] == 9
    assert all(Path(each["checkpoint"]).is_relative_to(directory) for each in haptic["folds"])


def test_each_label_map_is_of_the_sample_and_by_the_network_that_tested_it(directory):
    """Also of those that the first run drew under another number, of other networks."""
    folds = directory / "folds"
    networks = {fold: tl.load(folds / fold / "checkpoints" / "haptic.ckpt") for fold in "023"}
    for row, outcome in enumerate(read_outcomes(directory / "predictions" / "haptic.csv")):
        file = Path(outcome.files["haptic"])
        found = networks[file.stem.rpartition("_")[2]].explain(haptic=file)
        evidence = found.senses["haptic"]
        with Image.open(directory / f"label_maps/haptic/{row}/haptic/haptic.png") as image:
            strip = np.asarray(image)[0]
        centres = evidence.columns.mean(axis=1) / evidence.seconds * len(strip)
        own, taken, other = (to_rgb(colour) for colour in LEGEND.values())
        for centre, label in zip(centres, evidence.labels[0], strict=True):
            name = found.classes[label]
            colour = own if name == outcome.label else taken if name == outcome.predicted else other
            np.testing.assert_allclose(strip[int(centre), :3] / 255, colour, atol=0.01)


def rows(directory: Path) -> list[dict[str, str]]:
    with (directory / "sweep.csv").open() as stream:
        return list(csv.DictReader(stream))


def test_one_failing_job_does_not_hide_the_others(cli, tiny, tmp_path):
    quick = ["-m", "model=mfcc_nb", *tiny, "logger=csv", f"hydra.sweep.dir={tmp_path}"]
    assert cli(*quick, "data.test_fold=0,77").status == 1
    first, failed = rows(tmp_path)
    assert first["status"] == "done"
    assert "data.test_fold is 77" in failed["status"]
    assert "data.test_fold is 77" in (tmp_path / "1" / "failure.json").read_text()
    again = cli(*quick, "data.test_fold=0,3")
    assert again.status == 0, again.err
    first, second, pooled = rows(tmp_path)
    assert first["status"] == second["status"] == pooled["status"] == "done"
    assert pooled["job"] == "2 folds"
    assert int(pooled["test_samples"]) == 6
    assert int(pooled["correct"]) == int(first["correct"]) + int(second["correct"])


@pytest.mark.slow
def test_folds_run_side_by_side_through_joblib(cli, tiny, tmp_path):
    outcome = cli(
        "-m",
        "model=haptic",
        *tiny,
        "hydra/launcher=joblib",
        "hydra.launcher.n_jobs=2",
        "data.test_fold=0,2",
        f"hydra.sweep.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    assert [row["job"] for row in rows(tmp_path)] == ["0", "1", "2 folds"]
    assert "] Job 0: Fold 0, " in outcome.err
    assert "] Job 1: Fold 2, " in outcome.err
