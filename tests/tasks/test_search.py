"""What a job returns to a sweeper that searches."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import CLASSES, make_trace

import tex_lightning as tl
from tex_lightning.evaluation.outcomes import optimized_value


def losses(run: Path, network: str) -> list[float]:
    with (run / "metrics" / network / "metrics.csv").open() as stream:
        return [float(row["val/loss"]) for row in csv.DictReader(stream) if row["val/loss"]]


def value_of(run: Path) -> float | None:
    return optimized_value(json.loads((run / "results.json").read_text()))


def test_the_value_of_a_run_is_the_lowest_validation_loss(fused):
    assert value_of(fused) == pytest.approx(min(losses(fused, "fusion")), rel=1e-4)


def test_the_value_of_a_fit_without_steps_is_the_likelihood_of_its_validation_fold(
    bands, naive_bayes
):
    for run in (bands, naive_bayes):
        classifier, likely = tl.load(run).classifier, []
        for kind in range(len(CLASSES)):
            trace = torch.from_numpy(make_trace(kind, 1))[None]  # whose fold is the first
            likely.append(classifier.classify(haptic=trace).probabilities[kind])
        assert value_of(run) == pytest.approx(-np.log(likely).mean(), rel=1e-3)


def test_a_run_without_a_validation_fold_has_no_value(crossvalidated):
    assert value_of(crossvalidated) is None


@pytest.mark.parametrize(
    "how", [["data.val_fold=null"], ["task=crossval"], ["experiment=paper/haptic"]]
)
def test_a_search_that_could_choose_by_the_test_alone_is_refused_with_the_cure(cli, tmp_path, how):
    pytest.importorskip("optuna")
    outcome = cli(
        "-m", "model=haptic", *how, f"hydra.sweep.dir={tmp_path}", "hydra/sweeper=optuna",
        "hydra.sweeper.n_trials=2", "hydra.sweeper.n_jobs=1",
        "model.haptic.fit.learning_rate=interval(0.0001,0.01)",
    )  # fmt: skip
    assert outcome.status == 2
    (line,) = (text for text in outcome.err.splitlines() if text.startswith("Error: "))
    assert "give task=fit data.val_fold=1" in line
    assert not [*tmp_path.glob("*/results.json")]


@pytest.mark.slow
def test_optuna_searches(cli, tiny, tmp_path):
    pytest.importorskip("optuna")
    outcome = cli(
        "-m", "model=haptic", *tiny, "logger=csv", f"hydra.sweep.dir={tmp_path}",
        "hydra/sweeper=optuna", "hydra.sweeper.n_trials=3",
        "hydra.sweeper.n_jobs=1", "hydra.sweeper.sampler.seed=0",
        "model.haptic.fit.learning_rate=interval(0.0001,0.01)",
        "model.haptic.fit.score_shrinkage=null",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    found = min(min(losses(tmp_path / str(job), "haptic")) for job in range(3))
    (line,) = (
        text for text in (tmp_path / "optimization_results.yaml").read_text().splitlines()
        if text.startswith("best_value")
    )  # fmt: skip
    assert float(line.split()[1]) == pytest.approx(found, rel=1e-4)
