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
from tex_lightning.config.check import check_config
from tex_lightning.config.composition import Job, read_config
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.studies import family
from tex_lightning.studies.family import compose_family
from tex_lightning.tasks import frontier

CONTRACT = (
    "system", "kind", "parameters", "macs", "latency_ms_median", "latency_ms_p95", "fit_seconds",
    "vote_accuracy", "ci_low", "ci_high", "on_frontier", "chosen", "latency_ms_mean",
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


def test_a_finished_family_is_not_trained_again_and_no_vote_measures_its_own_choice(
    frontier_run, tiny, cli, tmp_path, monkeypatch
):
    """Other votes on a fold change what is chosen for the other, and nothing else."""
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
    procedure = read_results(run)["procedure"]
    assert procedure["chosen"] == {"0": "mfcc_nb", "5": "hapticnet_w0.5"}
    votes = read_csv(predictions(run, "mfcc_nb", 0))
    assert procedure["correct"] == sum(vote["label"] == vote["predicted"] for vote in votes)
    assert procedure["test_samples"] == 2 * len(votes)
    assert "is optimistic, and holds for these classes" in " ".join(outcome.err.split())


def noise(rng, fold: int) -> list[Outcome]:
    """Ten votes of a fold that know nothing of six classes."""
    return [
        Outcome({"haptic": f"{fold}_{number}.wav"}, "0", str(vote), 1.0, 1, int(vote == 0), 1.0)
        for number, vote in enumerate(rng.integers(6, size=10))
    ]


def test_on_votes_of_noise_the_expected_accuracy_is_chance():
    """The chosen system's own accuracy gains several points by being chosen on its votes."""
    config = SimpleNamespace(model=SimpleNamespace(modalities=["haptic"], kind="haptic"))
    expected, chosen = [], []
    for seed in range(50):
        rng = np.random.default_rng(seed)
        systems = [
            family.System(
                str(number), [], config, {"parameters": 1, "macs_per_sample": 1}, 1.0,
                tests={fold: noise(rng, fold) for fold in range(6)},
            )
            for number in range(8)
        ]  # fmt: skip
        votes = frontier._choose(systems, range(6)).outcomes
        chosen.append(np.mean([vote.label == vote.predicted for vote in votes]))
        expected.append(frontier._measure_choice(systems)["vote_accuracy"])
    error = np.std(expected, ddof=1) / np.sqrt(len(expected))
    assert abs(np.mean(expected) - 1 / 6) < 3 * error
    assert np.mean(chosen) > 1 / 6 + 3 * error


def make_job(tmp_path, *overrides: str) -> Job:
    return Job(overrides, tmp_path, "command", True, (), OmegaConf.create({}))


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["frontier.only=[minirocket]"], "minirocket needs aeon.*is not installed"),
        (["frontier.senses=[haptic,taste]"], "frontier.senses is taste"),
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
    config = read_config(job.compose(job.overrides))
    check_config(config)
    return config
