"""A small family, its table and the choice, through the command line."""

import csv
import json
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from omegaconf import OmegaConf

from tex_lightning import baselines
from tex_lightning.config import Job
from tex_lightning.config.check import check_config, read_config
from tex_lightning.config.composition import compose_for
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.studies import family
from tex_lightning.studies.family import compose_family, label_systems

CONTRACT = (
    "system", "kind", "parameters", "macs", "latency_ms_median", "latency_ms_p95", "fit_seconds",
    "vote_accuracy", "ci_low", "ci_high", "on_frontier", "chosen", "latency_ms_mean",
    "name",
)  # fmt: skip


def read_csv(path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(csv.DictReader(stream))


def read_results(directory) -> dict:
    return json.loads((directory / "results.json").read_text())


def predictions(directory, system: str, fold: int):
    """Votes on a fold by the networks trained without it."""
    return directory / "systems" / system / "folds" / str(fold) / "predictions" / "haptic.csv"


def test_table_has_the_columns_and_one_choice(frontier_run):
    rows = read_csv(frontier_run / "frontier.csv")
    assert list(rows[0]) == list(CONTRACT)
    assert len(rows) == 3
    assert [row["system"] for row in rows if row["chosen"] == "True"] == ["mfcc_nb"]
    means = [float(row["latency_ms_mean"]) for row in rows]
    assert means == sorted(means)


def test_readers_get_names_and_the_file_keeps_the_keys(frontier_run):
    rows = read_csv(frontier_run / "frontier.csv")
    names = {row["system"]: row["name"] for row in rows}
    assert names == {
        "hapticnet_w0.5": "HapticNet, width 0.5",
        "hapticnet_w0.5_sequential": "HapticNet, width 0.5, sequential",
        "mfcc_nb": "Modified MFCC decreasing + naive Bayes",
    }
    page = (frontier_run / "report.html").read_text()
    assert all(f"<td>{name}</td>" in page for name in names.values())
    log = next(frontier_run.glob("*.log")).read_text()
    assert "System 2/3, HapticNet, width 0.5, sequential: training without folds 0, 5." in log


def fake(name: str, overrides: str, model: str) -> family.System:
    senses = overrides.partition("model.senses=[")[2].partition("]")[0].split(",")
    config = SimpleNamespace(model=SimpleNamespace(name=model, senses=senses))
    return family.System(name, overrides.split(), config)


def test_names_say_model_and_settings_and_differ():
    systems = [
        fake("a", "model=haptic model.haptic.width=0.5 decision=sequential", "haptic"),
        fake("b", "model=visual_efficientnet data.half_scale=true", "visual_efficientnet"),
        fake("c", "model=fusion model.haptic.width=0.5 model.visual.width=0.25", "fusion"),
        fake("haptic+visual_sequential", "model.senses=[haptic,visual] decision=sequential", "x"),
        fake("mfcc", "model=mfcc_gmm model.senses=[sound] weights=null", "mfcc_gmm"),
        fake("mine", "model=my_net", "my_net"),
        fake("mine_too", "model=my_net weights=FILE", "my_net"),
    ]
    label_systems(systems)
    assert [system.label for system in systems] == [
        "HapticNet, width 0.5, sequential", "VisualNet on EfficientNet-Lite, half scale",
        "FusionNet-FC2, haptic width 0.5, visual width 0.25", "haptic + visual, sequential",
        "MFCC + GMM, sound", "my net (mine)", "my net (mine_too)",
    ]  # fmt: skip


def test_networks_that_differ_in_how_they_run_are_trained_once(frontier_run):
    assert len(list((frontier_run / "networks").iterdir())) == 2  # one for each fold


def test_sequential_decision_counts_the_arithmetic_that_was_done(frontier_run):
    macs = {row["system"]: row["macs"] for row in read_csv(frontier_run / "frontier.csv")}
    shares = [
        float(row["relative_macs"])
        for fold in (0, 5)
        for row in read_csv(predictions(frontier_run, "hapticnet_w0.5_sequential", fold))
    ]
    done = int(macs["hapticnet_w0.5_sequential"]) / int(macs["hapticnet_w0.5"])
    assert done == pytest.approx(np.mean(shares), rel=1e-4)
    assert macs["mfcc_nb"] == ""


def spoil(path) -> None:
    """Make every vote wrong."""
    rows = read_csv(path)
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row, "predicted": "none of them"} for row in rows)


def test_samples_and_chance_are_those_of_all_systems_and_classes():
    known = json.dumps(dict.fromkeys("abc", 0.3))
    outcomes = [Outcome({"haptic": f"{n}.wav"}, "a", "a", 1, 1, 1, 2.0, probabilities=known)
                for n in range(4)]  # fmt: skip
    systems = [family.System("x", [], None, tests={0: outcomes[:n]}) for n in (4, 3)]
    # b and c have no sample, and are guessed nevertheless
    assert family.tested_samples(systems) == ("3 to 4 test samples", 1 / 3)
    assert family.tested_samples(systems[:1])[0] == "4 test samples"


def test_a_finished_family_is_not_trained_again_and_its_votes_decide(
    frontier_run, tiny, cli, tmp_path, monkeypatch
):
    run = shutil.copytree(frontier_run, tmp_path / "run")
    names = ("hapticnet_w0.5", "mfcc_nb")  # the first is faster, so that it is chosen if in doubt
    for name in names:
        for fold in (0, 5):
            shutil.copy(predictions(frontier_run, "mfcc_nb", fold), predictions(run, name, fold))
    spoil(predictions(run, names[0], 5))

    cost = property(lambda system: 1.0 + names.index(system.name))
    monkeypatch.setattr(family.System, "cost", cost)
    only = f"frontier.only=[{','.join(names)}]"
    outcome = cli("task=frontier", *tiny, "crossval.only=[0,5]", only, "data.classes=3",
                  f"hydra.run.dir={run}")  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert read_results(run)["chosen"] == "mfcc_nb"
    assert "is optimistic, and holds for these classes" in " ".join(outcome.err.split())


def make_job(tmp_path, *overrides: str) -> Job:
    empty = OmegaConf.create({})
    return Job(overrides, tmp_path, "command", True, (), empty, empty)


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["frontier.only=[minirocket]"], "minirocket needs aeon.*is not installed"),
        (["frontier.senses=[haptic,taste]"], "frontier.senses is taste"),
        (["model=visual"], "No system of this family has model=visual; choose a family"),
    ],
)
def test_what_cannot_be_meant_is_refused(overrides, message, tmp_path, monkeypatch):
    monkeypatch.delitem(sys.modules, "tex_lightning.baselines.rocket", raising=False)
    monkeypatch.delattr(baselines, "rocket", raising=False)
    monkeypatch.setitem(sys.modules, "aeon.transformations.collection.convolution_based", None)
    job = make_job(tmp_path, "task=frontier", *overrides)
    with pytest.raises(UserError, match=message):
        compose_family(check_composed(job), job)


def check_composed(job: Job):
    config = read_config(compose_for(job, job.overrides))
    check_config(config)
    return config
