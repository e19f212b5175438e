"""Loggers and callbacks named by ``_target_``: what reaches them."""

import csv
import json
from pathlib import Path

import pytest
from own_parts import EpochCounter, MemoryLogger

from tex_lightning.errors import UserError
from tex_lightning.learning.loggers import open_loggers

VOTES = ("loss", "fragment_accuracy", "vote_accuracy")


def arguments(surfaces: Path) -> list[str]:
    return [
        "model=haptic", "data=folder", f"data.root={surfaces}", "debug=tiny", "trainer.threads=1",
    ]  # fmt: skip


@pytest.fixture(scope="module")
def run(run_once, surfaces) -> Path:
    return run_once(
        *arguments(surfaces),
        "+logger.mine._target_=own_parts.MemoryLogger",
        "+callbacks.mine._target_=own_parts.EpochCounter",
        "decision.unknown=0.05",  # without classes held out, on which a figure could be had
    )


def test_a_users_logger_gets_metrics_and_hyper_parameters(run):
    logger = MemoryLogger.kept["haptic"]
    assert logger.metrics.keys() >= {
        "train/loss", "train/fragment_accuracy", "lr/head", *(f"val/{name}" for name in VOTES),
        "test/fragment_accuracy", "test/latency_ms", "test/fit_seconds",
    }  # fmt: skip
    assert len(logger.metrics["val/loss"]) == 2  # one each epoch
    entry = json.loads((run / "results.json").read_text())["networks"]["haptic"]
    assert logger.metrics["test/vote_accuracy"] == [entry["vote_accuracy"]]
    for name, value in entry["calibration"].items():
        assert logger.metrics[f"test/{name}"] == [value]
    assert entry["unknown"]["rate"] == 0.05
    assert logger.params["haptic.fit.epochs"] == EpochCounter.epochs == 2
    assert logger.params["seed"] == 0
    with (run / "metrics" / "haptic" / "metrics.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    for name in ("train/loss", "val/vote_accuracy", "test/ece"):
        written = [float(row[name]) for row in rows if row[name]]
        assert written == pytest.approx(logger.metrics[name], rel=1e-4)


@pytest.mark.parametrize(
    ("node", "said"),
    [
        ("text", "has no _target_; name the class there"),
        (
            {"_target_": "own_parts.NothingOfLightning"},
            r"names own_parts\.NothingOfLightning",
        ),
    ],
)
def test_a_logger_that_is_none_is_named(node, said, tmp_path):
    with pytest.raises(UserError, match=rf"logger\.mine {said}"):
        open_loggers({"mine": node}, tmp_path, "haptic")


def test_an_evaluation_is_logged_too(cli, run, surfaces, tmp_path):
    outcome = cli(
        "task=evaluate", f"checkpoint={run}/checkpoints/haptic.ckpt", "data=folder",
        f"data.root={surfaces}", "+logger.mine._target_=own_parts.MemoryLogger",
        f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    logger = MemoryLogger.kept["haptic"]
    entry = json.loads((tmp_path / "results.json").read_text())["networks"]["haptic"]
    assert logger.metrics["test/vote_accuracy"] == [entry["vote_accuracy"]]
