"""What a job returns to a sweeper that searches."""

import csv
import json
from pathlib import Path

import pytest

from tex_lightning.evaluation.outcomes import optimized_value


def losses(run: Path, network: str) -> list[float]:
    with (run / "metrics" / network / "metrics.csv").open() as stream:
        return [float(row["val/loss"]) for row in csv.DictReader(stream) if row["val/loss"]]


def test_the_value_of_a_run_is_the_lowest_validation_loss_or_the_vote_error(fused):
    results = json.loads((fused / "results.json").read_text())
    assert optimized_value(results) == pytest.approx(min(losses(fused, "fusion")), rel=1e-4)
    results["networks"]["fusion"] |= {"val_loss": None, "vote_accuracy": 0.75}
    assert optimized_value(results) == 0.25


@pytest.mark.slow
def test_optuna_searches(cli, tiny, tmp_path):
    pytest.importorskip("optuna")
    outcome = cli(
        "-m", "model=haptic", *tiny, "logger=csv", f"hydra.sweep.dir={tmp_path}",
        "hydra/sweeper=optuna", "hydra.sweeper.n_trials=3",
        "hydra.sweeper.n_jobs=1", "hydra.sweeper.sampler.seed=0",
        "model.haptic.fit.learning_rate=interval(0.0001,0.01)",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    found = min(min(losses(tmp_path / str(job), "haptic")) for job in range(3))
    (line,) = (
        text for text in (tmp_path / "optimization_results.yaml").read_text().splitlines()
        if text.startswith("best_value")
    )  # fmt: skip
    assert float(line.split()[1]) == pytest.approx(found, rel=1e-4)
