"""``task=stability`` from the command line: its files, its protocol, what it refuses."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.stats import binomtest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.evaluation.outcomes import read_outcomes

ONLY = ("white_noise", "shorter_trace", "rotated_axes", "jpeg", "haptic_missing", "image_swapped")
COLUMNS = (
    "system modality perturbation severity test_samples vote_accuracy ci_low ci_high flip_rate"
)


def data(surfaces: Path) -> list[str]:
    return ["data=folder", f"data.root={surfaces}", "data.half_scale=false", "logger=csv"]


@pytest.fixture(scope="module")
def folds(run_once, surfaces) -> Path:
    only = "crossval.only=[0,2]"
    return run_once("model=minirocket", "debug=tiny", "task=crossval", only, *data(surfaces))


@pytest.fixture(scope="module")
def tested(run_once, surfaces, fused, folds) -> Path:
    return run_once(
        "task=stability",
        f"stability.systems=[{fused},{folds},{fused}/checkpoints/haptic.ckpt]",
        f"stability.only=[{','.join(ONLY)}]",
        "stability.bisections=2",
        "stability.bound=1",
        *data(surfaces),
        "logger=tensorboard",
    )


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_table_has_every_trial_with_its_interval(tested, fused):
    lines = table(tested / "stability.csv")
    assert list(lines[0]) == COLUMNS.split()
    systems = {line["system"] for line in lines}
    assert systems == {"fusion", "visual", "minirocket", "haptic (1)", "haptic (2)"}
    for name in ("white_noise", "shorter_trace", "jpeg", "haptic_missing", "image_swapped"):
        found = [line for line in lines if line["perturbation"] == name]
        for system in {line["system"] for line in found}:
            severities = [line["severity"] for line in found if line["system"] == system]
            assert severities == ["0", "1", "2", "3", "4", "5"]
    assert "rotated_axes" not in {line["perturbation"] for line in lines}  # one axis only
    for line in lines:
        count, share = int(line["test_samples"]), float(line["vote_accuracy"])
        interval = binomtest(round(share * count), count).proportion_ci(method="wilson")
        assert float(line["ci_low"]) == pytest.approx(interval.low)
        assert float(line["ci_high"]) == pytest.approx(interval.high)
        if line["severity"] == "0":
            assert float(line["flip_rate"]) == 0
    met = {line["perturbation"] for line in lines if line["system"] == "visual"}
    assert met == {"jpeg"}


def test_clean_accuracy_is_that_of_the_test_after_training(tested, fused, folds):
    systems = json.loads((tested / "results.json").read_text())["systems"]
    for name, kind in (("fusion", "fusion"), ("visual", "visual")):
        outcomes = read_outcomes(fused / "predictions" / f"{kind}.csv")
        clean = systems[name]["clean"]
        assert clean["correct"] == sum(each.label == each.predicted for each in outcomes)
        assert clean["test_samples"] == len(outcomes)
    pooled = json.loads((folds / "results.json").read_text())["networks"]["haptic"]
    assert systems["minirocket"]["clean"]["correct"] == pooled["correct"]
    assert systems["minirocket"]["clean"]["test_samples"] == pooled["test_samples"] == 6
    assert len(systems["minirocket"]["checkpoints"]) == 2


def test_a_trace_below_the_receptive_field_counts_as_wrong(tested):
    (trial,) = (
        line
        for line in table(tested / "stability.csv")
        if (line["system"], line["perturbation"], line["severity"])
        == ("fusion", "shorter_trace", "5")
    )
    assert (float(trial["vote_accuracy"]), float(trial["flip_rate"])) == (0, 1)


def test_without_its_trace_fusion_votes_as_its_visual_part(tested, fused):
    lines = table(tested / "stability.csv")
    found = [line for line in lines if line["perturbation"] == "haptic_missing"]
    assert {line["system"] for line in found} == {"fusion"}
    assert {line["modality"] for line in found} == {"both"}
    fusion = SurfaceClassifier.from_checkpoint(fused / "checkpoints" / "fusion.ckpt")
    part, right = fusion.with_senses(["visual"]), []
    for each in read_outcomes(fused / "predictions" / "fusion.csv"):
        decoded, _ = part.senses["visual"].decoder.decode(Path(each.files["image"]))
        vote = part.classify(image=torch.from_numpy(decoded))
        right.append(fusion.card.classes[vote.label] == each.label)
    assert float(found[-1]["vote_accuracy"]) == pytest.approx(np.mean(right))


def test_breaking_points_lie_below_the_bound(tested):
    lines = table(tested / "breaking_points.csv")
    for line in lines:
        least = float(line["least_accuracy"])
        assert least == pytest.approx(float(line["clean_accuracy"]))
        if line["reached"] == "true":
            assert float(line["vote_accuracy"]) < least
            assert float(line["severity"]) % 0.25 == 0
    short = next(
        line
        for line in lines
        if (line["system"], line["perturbation"]) == ("fusion", "shorter_trace")
    )
    if float(short["clean_accuracy"]) > 0:
        assert 1.5 <= float(short["value"]) <= 2.4


def test_results_and_figures_are_there(tested):
    results = json.loads((tested / "results.json").read_text())
    assert results["task"] == "stability"
    assert results["wall_seconds"] > 0
    assert results["environment"]["versions"]["torch"]
    assert set(results["perturbations"]) == set(ONLY) - {"rotated_axes"}
    fusion = results["systems"]["fusion"]
    errors = fusion["perturbation_errors"]
    assert fusion["mean_error"] == pytest.approx(np.mean(list(errors.values())))
    for name in ("heat_map", "curves_haptic", "curves_image", "curves_both"):
        assert (tested / "figures" / f"{name}.png").stat().st_size > 5000
    events = EventAccumulator(str(tested / "tensorboard" / "fusion")).Reload()
    assert len(events.Scalars("haptic/white_noise")) == 6


def test_the_same_seed_gives_the_same_table(run_once, surfaces, fused, tested):
    again = run_once(
        "task=stability",
        f"stability.systems=[{fused}]",
        "stability.parts=false",
        "stability.only=[white_noise]",
        *data(surfaces),
    )
    first = [
        line
        for line in table(tested / "stability.csv")
        if (line["system"], line["perturbation"]) == ("fusion", "white_noise")
    ]
    assert table(again / "stability.csv") == first


def test_mistakes_end_in_one_sentence(cli, surfaces, fused, folds, tmp_path):
    common = ["task=stability", *data(surfaces), f"hydra.run.dir={tmp_path}/run"]

    def refuse(message, *arguments):
        outcome = cli(*common, *arguments)
        assert outcome.status == 2, outcome.err
        assert message in outcome.err
        assert "Traceback" not in outcome.err

    refuse("task=stability needs one")
    refuse("task=stability needs one", "stability.systems=[]")
    refuse("does not exist; give a run folder", "stability.systems=[/nowhere]")
    refuse("holds no finished checkpoint", f"stability.systems=[{tmp_path}]")
    refuse("has trained on 6 of the 6 test", f"stability.systems=[{fused}]", "data.test_fold=4")
    systems = f"stability.systems=[{folds}]"
    refuse("(did you mean white_noise?)", systems, "stability.only=[white_nose]")
    refuse("No system meets jpeg", systems, "stability.only=[jpeg]")
    refuse("stability.bound is 2", systems, "stability.bound=2")
    refuse("holds no finished checkpoint", systems, "stability.folds=[5]")
    outcome = cli("task=generate", systems)
    assert "read by task=stability alone" in outcome.err
