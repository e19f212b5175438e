"""What a job returns to a sweeper that searches."""

import csv
import json
from pathlib import Path

import pytest
from own_parts import JobReturns

from tex_lightning.evaluation.outcomes import optimized_value


def sweep(surfaces: Path, directory: Path) -> list[str]:
    return [
        "-m", "model=haptic", "data=folder", f"data.root={surfaces}", "debug=tiny", "logger=csv",
        "trainer.threads=1", f"hydra.sweep.dir={directory}",
    ]  # fmt: skip


def losses(job: Path) -> list[float]:
    with (job / "metrics" / "haptic" / "metrics.csv").open() as stream:
        return [float(row["val/loss"]) for row in csv.DictReader(stream) if row["val/loss"]]


def vote_error(job: Path) -> float:
    results = json.loads((job / "results.json").read_text())
    return 1 - results["networks"]["haptic"]["vote_accuracy"]


def test_jobs_return_the_lowest_validation_loss_or_the_vote_error(cli, surfaces, tmp_path):
    JobReturns.values.clear()
    outcome = cli(
        *sweep(surfaces, tmp_path), "+hydra.callbacks.returned._target_=own_parts.JobReturns",
        "data.val_fold=1,null",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    validated, unvalidated = JobReturns.values
    assert len(losses(tmp_path / "0")) == 2
    assert validated == pytest.approx(min(losses(tmp_path / "0")), rel=1e-4)
    assert unvalidated == vote_error(tmp_path / "1")
    results = json.loads((tmp_path / "1" / "results.json").read_text())
    assert results["networks"]["haptic"]["val_loss"] is None


def test_the_network_that_was_asked_for_counts():
    networks = {
        "haptic": {"val_loss": 0.1, "vote_accuracy": 0.9},
        "fusion": {"val_loss": 0.2, "vote_accuracy": 0.7},
    }
    assert optimized_value({"networks": networks}) == 0.2


@pytest.mark.slow
def test_optuna_searches(cli, surfaces, tmp_path):
    pytest.importorskip("optuna")
    outcome = cli(
        *sweep(surfaces, tmp_path), "hydra/sweeper=optuna", "hydra.sweeper.n_trials=3",
        "hydra.sweeper.n_jobs=1", "hydra.sweeper.sampler.seed=0",
        "model.haptic.fit.learning_rate=interval(0.0001,0.01)",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    found = min(min(losses(tmp_path / str(job))) for job in range(3))
    (line,) = (
        text for text in (tmp_path / "optimization_results.yaml").read_text().splitlines()
        if text.startswith("best_value")
    )  # fmt: skip
    assert float(line.split()[1]) == pytest.approx(found, rel=1e-4)
