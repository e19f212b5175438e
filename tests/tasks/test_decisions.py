"""Sequential decisions, calibration, rejection and unknown materials from the command line."""

import json
from pathlib import Path

import pytest
import torch
from scipy.stats import beta

import tex_lightning as tl
from tex_lightning.evaluation.calibration import upper_bound
from tex_lightning.evaluation.outcomes import read_outcomes


@pytest.fixture(scope="module")
def sequential(run_once, tiny) -> Path:
    decision = ["decision=sequential", "decision.disagreement=0.9", "decision.reject_below=0.5"]
    return run_once("model=fusion", *decision, "logger=csv", *tiny)


def networks(directory: Path) -> dict:
    return json.loads((directory / "results.json").read_text())["networks"]


def test_a_sequential_run_says_what_it_saved(sequential):
    for name in ("haptic", "visual", "fusion"):
        outcomes = read_outcomes(sequential / "predictions" / f"{name}.csv")
        mean = sum(outcome.relative_macs for outcome in outcomes) / len(outcomes)
        assert 0 < mean <= 1.5
        assert networks(sequential)[name].get("relative_macs", 1) == pytest.approx(mean)


def test_a_sequential_run_says_how_far_to_believe_it(sequential):
    for name in ("haptic", "visual", "fusion"):
        entry = networks(sequential)[name]
        assert set(entry["calibration"]) == {"ece", "augrc"}
        assert 0 <= entry["selective"]["coverage"] <= 1
        assert (sequential / "figures" / f"{name}_calibration.png").is_file()
        path = sequential / "checkpoints" / f"{name}.ckpt"
        card = torch.load(path, weights_only=True)["hyper_parameters"]["card"]
        assert 0.1 <= card["calibration"]["temperature"] <= 10
        assert ("disagreement" in card["calibration"]) == (name != "visual")


def test_predictions_say_what_they_looked_at(cli, sequential, surfaces):
    files = {
        "haptic": surfaces / "alpha/haptic/alpha_0.wav",
        "image": surfaces / "alpha/image/alpha_0.png",
    }
    sure = ["decision=sequential", "decision.calibrated=false", "decision.confidence_threshold=0"]
    given = [f"{name}={file}" for name, file in files.items()]
    quick = cli("task=predict", f"checkpoint={sequential}", *given, *sure)
    assert quick.status == 0, quick.err
    line = json.loads(quick.out)
    assert 0 < line["relative_macs"] < 1
    assert line["fragments"] < 10
    assert line["rejected"] is (line["probability"] < 0.5)  # the threshold of the training
    whole = tl.load(sequential, "decision.reject_below=1").predict(**files)
    assert (whole.relative_macs, whole.fragments) == (1, 50)  # pairs of debug=tiny
    assert (whole.rejected, whole.label) == (True, None)
    kept = tl.load(sequential, "decision.reject_below=0", "decision.pairs=7").predict(**files)
    assert (kept.rejected, kept.fragments) == (False, 7)
    assert kept.label in ("alpha", "beta", "gamma")
    mean = tl.load(sequential, "decision.rule=mean").predict(**files)
    unsure = ["decision=sequential", "decision.calibrated=false", "decision.confidence_threshold=1"]
    asked = tl.load(sequential, "decision.rule=mean", *unsure).predict(**files)
    assert asked.probability == pytest.approx(mean.probability)


def test_the_threshold_of_rejection_travels_with_the_checkpoint(
    cli, sequential, surfaces, tmp_path
):
    run = ["task=evaluate", f"checkpoint={sequential}/checkpoints/haptic.ckpt", "data=folder"]
    run += [f"data.root={surfaces}", "logger=csv", "decision=max_vote"]
    selective = {}
    for threshold in (None, 0.25):
        given = [] if threshold is None else [f"decision.reject_below={threshold}"]
        outcome = cli(*run, *given, f"hydra.run.dir={tmp_path}/{threshold}")
        assert outcome.status == 0, outcome.err
        selective[threshold] = networks(tmp_path / str(threshold))["haptic"]["selective"]
    assert selective[None]["reject_below"] == 0.5
    assert selective[0.25]["reject_below"] == 0.25


def test_held_out_classes_are_tested_and_never_trained_on(cli, surfaces, tmp_path):
    outcome = cli(
        "task=crossval",
        "model=haptic",
        "decision=sequential",
        "crossval.only=[0,3]",
        "data=folder",
        f"data.root={surfaces}",
        "data.hold_out=[gamma]",
        "debug=tiny",
        "logger=csv",
        f"hydra.run.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    haptic = networks(tmp_path)["haptic"]
    card = torch.load(haptic["checkpoint"], weights_only=True)["hyper_parameters"]["card"]
    assert card["classes"] == ["alpha", "beta"]
    assert card["calibration"] == {}
    assert haptic["test_samples"] == 4
    assert haptic["unknown"]["classes"] == ["gamma"]
    assert haptic["unknown"]["samples"] == 2
    assert 0 <= haptic["unknown"]["auroc"] <= 1


@pytest.mark.parametrize(
    ("argument", "said"),
    [
        ("decision.alpha=1.5", "decision.alpha is 1.5"),
        ("data.hold_out=[granite]", "data.hold_out names granite, and the data has no such"),
        ("data.hold_out=[alpha beta]", "with commas between names"),
        ("model=minirocket", "decision=sequential needs a network"),
    ],
)
def test_what_cannot_be_meant_is_refused(cli, surfaces, argument, said):
    data = ["data=folder", f"data.root={surfaces}", "model=haptic"]
    outcome = cli(*data, "decision=sequential", argument)
    assert outcome.status == 2
    assert said in outcome.err


def test_the_bound_is_clopper_pearsons():
    assert upper_bound(0, 29, 0.95) == pytest.approx(1 - 0.05 ** (1 / 29))
    assert upper_bound(2, 40, 0.95) == pytest.approx(beta(3, 38).ppf(0.95))
