"""A small family, its charts and the choice, through the command line."""

import csv
import json
import shutil
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from tex_lightning.classifier.card import read_checkpoint
from tex_lightning.evaluation.comparison import one_standard_error, partner
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.frontier_chart import write_frontier
from tex_lightning.studies import family
from tex_lightning.studies.family import Latency
from tex_lightning.tasks import frontier

CONTRACT = (
    "system", "kind", "parameters", "macs", "latency_ms_median", "latency_ms_p95", "fit_seconds",
    "vote_accuracy", "ci_low", "ci_high", "on_frontier", "chosen", "test_samples",
    "chosen_in_folds", "latency_ms_mean",
)  # fmt: skip


@pytest.fixture(scope="module")
def measured(run_once, tiny):
    return run_once(
        "task=frontier", *tiny, "data.classes=3", "crossval.only=[0]",
        "frontier.only=[hapticnet_w0.125,hapticnet_w0.5,hapticnet_w0.5_bf16,"
        "hapticnet_w0.5_sequential,minirocket]",
    )  # fmt: skip


def read_csv(path) -> list[dict[str, str]]:
    with path.open() as stream:
        return list(csv.DictReader(stream))


def read_results(directory) -> dict:
    return json.loads((directory / "results.json").read_text())


def predictions(directory, system: str, fold: int):
    """Votes on fold 0 or on its partner, fold 5, by the networks trained without both."""
    name = "haptic.csv" if fold == 0 else "haptic_partner.csv"
    return directory / "systems" / system / "folds" / "0-5" / "predictions" / name


def test_table_has_the_columns_and_one_choice(measured):
    rows = read_csv(measured / "frontier.csv")
    assert list(rows[0]) == list(CONTRACT)
    assert len(rows) == 6
    assert [row["system"] for row in rows if row["chosen"] == "True"] == ["minirocket"]
    assert rows[0]["kind"] == "procedure"  # what to expect comes first
    means = [float(row["latency_ms_mean"]) for row in rows[1:]]
    assert means == sorted(means)


def test_systems_are_trained_without_the_tested_fold_and_its_partner(measured):
    folder = measured / "systems" / "minirocket" / "folds" / "0-5"
    card = read_checkpoint(folder / "checkpoints" / "haptic.ckpt")["hyper_parameters"]["card"]
    assert len(card["trained_on"]["seen"]) == 3 * 8
    for number in (0, 5):
        votes = read_csv(predictions(measured, "minirocket", number))
        assert {line["haptic"][-5] for line in votes} == {str(number)}


def test_the_choice_is_a_row_of_its_own(frontier_run):
    rows = read_csv(frontier_run / "frontier.csv")
    assert len(rows) == 3
    procedure = next(row for row in rows if row["kind"] == "procedure")
    assert procedure["parameters"] == procedure["macs"] == procedure["chosen_in_folds"] == ""
    counted = [int(row["chosen_in_folds"]) for row in rows if row is not procedure]
    assert sum(counted) == 2
    results = read_results(frontier_run)["procedure"]
    assert float(procedure["vote_accuracy"]) == results["correct"] / results["test_samples"]
    assert float(procedure["ci_low"]) == results["vote_ci95"][0]


def test_no_vote_takes_part_in_the_choice_that_it_measures(
    frontier_run, tiny, cli, tmp_path, monkeypatch
):
    """Other votes on a fold change what is chosen for its partner, and nothing else."""
    run = tmp_path / "run"
    shutil.copytree(frontier_run, run)
    spoil(predictions(run, "mfcc_gmm", 5))  # the quicker one, so that it is chosen if in doubt
    timings = {name: Latency(ms, ms, ms) for name, ms in (("mfcc_gmm", 1.0), ("mfcc_nb", 2.0))}
    monkeypatch.setattr(frontier, "measure_latencies", lambda *_: timings)
    only = "frontier.only=[mfcc_gmm,mfcc_nb]"
    outcome = cli("task=frontier", *tiny, only, f"hydra.run.dir={run}")
    assert outcome.status == 0, outcome.err
    folds = {fold["fold"]: fold for fold in read_results(run)["procedure"]["folds"]}
    assert {number: found["chosen"] for number, found in folds.items()} == {
        0: "mfcc_nb",
        5: "mfcc_gmm",
    }
    for number, found in folds.items():
        votes = read_csv(predictions(run, found["chosen"], number))
        assert found["correct"] == sum(vote["label"] == vote["predicted"] for vote in votes)
        assert found["test_samples"] == len(votes)
    assert folds[5]["correct"] == 0


def noise(rng, fold: int) -> list[Outcome]:
    """Ten votes of a fold that know nothing of six classes."""
    votes = rng.integers(6, size=10)
    files = [{"haptic": f"{fold}_{number}.wav"} for number in range(10)]
    return [
        Outcome(files[number], "0", str(vote), 1.0, 1, int(vote == 0), 1.0)
        for number, vote in enumerate(votes)
    ]


def noise_family(rng) -> list[family.System]:
    """Eight systems of which none is better than chance, on six folds."""
    config = SimpleNamespace(model=SimpleNamespace(modalities=["haptic"], kind="haptic"))
    return [
        family.System(
            str(number), [], config, {"parameters": 1, "macs_per_sample": 1}, 1.0,
            tests={fold: noise(rng, fold) for fold in range(6)},
            partners={fold: noise(rng, partner(fold, 6)) for fold in range(6)},
        )
        for number in range(8)
    ]  # fmt: skip


def test_of_votes_of_noise_the_accuracy_that_is_shown_first_is_chance(tmp_path):
    """The chosen system's own accuracy gains several points by being chosen on its votes."""
    first, own = [], []
    timings = {str(number): Latency(number, number, number) for number in range(8)}
    for seed in range(150):
        systems = noise_family(np.random.default_rng(seed))
        candidates = frontier._candidates(systems, timings, [each.tests for each in systems])
        chosen = one_standard_error(candidates).name
        procedure = frontier._procedure(systems, timings)
        points = frontier._points(systems, timings, chosen, procedure)
        write_frontier([*points, frontier._procedure_point(procedure, points)], tmp_path / "f.csv")
        rows = read_csv(tmp_path / "f.csv")
        assert rows[0]["kind"] == "procedure"
        first.append(float(rows[0]["vote_accuracy"]))
        own += [float(row["vote_accuracy"]) for row in rows if row["chosen"] == "True"]
    error = np.std(first, ddof=1) / np.sqrt(len(first))
    assert abs(np.mean(first) - 1 / 6) < 3 * error
    assert np.mean(own) > 1 / 6 + 3 * error


def spoil(path) -> None:
    """Make every vote wrong."""
    rows = read_csv(path)
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows({**row, "predicted": "none of them"} for row in rows)


def test_missing_libraries_are_named_before_anything_is_trained(tiny, cli, tmp_path, monkeypatch):
    for module in ("aeon.transformations.collection.convolution_based", "skimage.feature"):
        monkeypatch.setitem(sys.modules, module, None)  # as if not installed
    for module in ("rocket", "patterns"):
        monkeypatch.delitem(sys.modules, f"tex_lightning.baselines.{module}", raising=False)
    only = "frontier.only=[hapticnet_w0.125,minirocket,lbp]"
    outcome = cli("task=frontier", "frontier=fusion", *tiny, only, f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 2
    assert "minirocket (aeon" in outcome.err
    assert "lbp (skimage" in outcome.err
    assert "pip install 'tex_lightning[baselines]'" in outcome.err
    assert "frontier.only=[hapticnet_w0.125]." in outcome.err
    assert not (tmp_path / "r" / "systems").exists()


def test_sequential_decision_counts_the_arithmetic_that_was_done(measured):
    with (measured / "frontier.csv").open() as stream:
        macs = {row["system"]: row["macs"] for row in csv.DictReader(stream)}
    outcomes = predictions(measured, "hapticnet_w0.5_sequential", 0)
    with outcomes.open() as stream:
        relative_macs = [float(row["relative_macs"]) for row in csv.DictReader(stream)]
    done = int(macs["hapticnet_w0.5_sequential"]) / int(macs["hapticnet_w0.5"])
    assert done == pytest.approx(sum(relative_macs) / len(relative_macs), rel=1e-4)
    assert macs["minirocket"] == ""


def test_networks_that_differ_in_precision_are_trained_once(measured):
    assert len(list((measured / "networks").iterdir())) == 2


def test_every_system_is_timed_on_photos_of_its_own_size(tiny, cli, monkeypatch):
    sides = {}

    def classify(classifier, samples):
        half_scale = classifier.card.senses["visual"]["decode"]["half_scale"]
        sides[half_scale] = next(samples)["image"].shape[0]

    monkeypatch.setattr(family, "_classify_next", classify)
    systems = "frontier.only=[visualnet_efficientnet_lite0,visualnet_efficientnet_lite0_half]"
    only = "crossval.only=[0]", "data.half_scale=false"
    assert cli("task=frontier", "frontier=fusion", *tiny, *only, systems).status == 0
    assert sides[False] == 2 * sides[True]


def test_auto_chooses_without_the_fold_that_it_tests(tiny, cli, tmp_path, monkeypatch):
    measure = frontier.run

    def measure_one(config, directory):
        only = replace(config.frontier, only=["mfcc_nb"])
        return measure(replace(config, frontier=only), directory)

    monkeypatch.setattr(frontier, "run", measure_one)
    choice = "model=auto", "data.test_fold=3", "data.val_fold=4", f"hydra.run.dir={tmp_path}/r"
    outcome = cli(*choice, *tiny)
    assert outcome.status == 0, outcome.err
    assert read_results(tmp_path / "r")["model"] == "mfcc_nb"
    folder = tmp_path / "r/frontier/systems/mfcc_nb/folds/3-8"
    card = read_checkpoint(folder / "checkpoints/haptic.ckpt")["hyper_parameters"]["card"]
    assert len(card["trained_on"]["seen"]) == 2 * 8  # of two classes neither fold 3 nor fold 8


def test_auto_goes_on_with_the_choice_that_it_made(tiny, cli, tmp_path, monkeypatch):
    def measure_again(*_: object) -> None:
        raise AssertionError("the family was measured a second time")

    monkeypatch.setattr(frontier, "run", measure_again)
    made = tmp_path / "r" / "frontier" / "results.json"
    made.parent.mkdir(parents=True)
    choice = {"fold": 0, "overrides": ["model=minirocket"]}
    made.write_text(json.dumps({"overrides": ["model=acnn"], "procedure": {"folds": [choice]}}))
    outcome = cli("model=auto", "data.val_fold=2", *tiny, f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 0, outcome.err
    assert json.loads((tmp_path / "r/results.json").read_text())["model"] == "minirocket"


@pytest.mark.parametrize("smoke", [False, True])
def test_a_system_is_recommended_unless_it_was_a_smoke_test(
    smoke, measured, tiny, cli, monkeypatch
):
    monkeypatch.setattr(frontier, "is_tiny", lambda _: smoke)
    outcome = cli(
        "task=frontier", *tiny, "data.classes=3", "crossval.only=[0]",
        f"hydra.run.dir={measured}", "frontier.only=[minirocket]",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert "figures mean nothing" in outcome.err
    assert outcome.err.count("python -m tex_lightning model=") == (0 if smoke else 1)
    assert ("(chosen)" in outcome.err) is not smoke
    if not smoke:
        assert "is optimistic, and holds for these classes" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["task=frontier", "frontier.only=[nothing]"], "does not have"),
        (
            ["task=frontier", "frontier.systems.mfcc_nb=null", "frontier.only=[mfcc_nb]"],
            "does not have",
        ),
        (["model=auto", "task=crossval"], "use task=fit"),
        (["model=auto", "frontier.run=nowhere"], "no finished frontier"),
        (["model=auto", "data.inverted=true"], "model=auto would choose on what"),
        (["task=frontier", "data.folds=2"], "two are left out of training, choose 3 or more"),
    ],
)
def test_what_cannot_be_meant_is_refused(arguments, message, tiny, cli, tmp_path):
    outcome = cli(*arguments, *tiny, f"hydra.run.dir={tmp_path}/r")
    assert outcome.status == 2
    assert message in outcome.err
