"""Loggers and callbacks named by ``_target_``: what reaches them."""

import csv
import json
from pathlib import Path

import pytest
import torch
from conftest import make_card
from event_files import runs
from own_parts import EpochCounter, MemoryLogger

from tex_lightning.errors import UserError
from tex_lightning.learning.loggers import RunLogger, open_loggers
from tex_lightning.learning.module import SurfaceModule

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
        "logger.tensorboard.log_graph=true",
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


def test_the_graph_is_shown_on_demand(run, fused):
    (events,) = runs(run).values()
    operations = {node.op for node in events.Graph().node}
    assert "aten::_convolution" in operations
    assert not any(found.Tags()["graph"] for found in runs(fused).values())


def test_tracing_a_graph_changes_nothing_of_the_training(tmp_path):
    fit = {"head_factor": 1.0, "augmentation": None}
    module = SurfaceModule(make_card("haptic", "visual", width=0.1), fit, 0,
                           {"haptic": 256, "visual": 224}).train()  # fmt: skip
    module.classifier.senses["haptic"].network.eval()  # as what is trained already stays
    before = [part.training for part in module.modules()]
    torch.manual_seed(0)
    expected = torch.rand(1)
    torch.manual_seed(0)
    logger = RunLogger(tmp_path, "tensorboard", "5-fusion", log_graph=True)
    logger.log_graph(module)
    assert torch.equal(torch.rand(1), expected)
    assert [part.training for part in module.modules()] == before
    logger.finalize("success")
    (events,) = runs(tmp_path).values()
    assert any("FusionLayer" in node.name for node in events.Graph().node)


def test_a_network_that_cannot_be_traced_is_told_and_trained(tmp_path, monkeypatch, caplog):
    module = SurfaceModule(make_card("haptic", width=0.1), {"augmentation": None}, 0,
                           {"haptic": 256})  # fmt: skip
    monkeypatch.setattr(SurfaceModule, "forward", lambda *_: {"scores": {1: "text"}})
    logger = RunLogger(tmp_path, "tensorboard", "1-haptic", log_graph=True)
    logger.log_graph(module)
    logger.finalize("success")
    assert "There is no graph of this network for TensorBoard" in caplog.text


def test_mlflow_gets_the_same_figures_as_artifacts(cli, fused, surfaces, tmp_path):
    pytest.importorskip("mlflow")
    outcome = cli(
        "task=evaluate", f"checkpoint={fused}/checkpoints/haptic.ckpt", "data=folder",
        f"data.root={surfaces}", "logger=mlflow", f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    (home,) = tmp_path.glob("mlartifacts/*/artifacts/test")
    there = {str(file.relative_to(home)) for file in home.rglob("*") if file.is_file()}
    assert there >= {
        "confusion/recordings.png", "1 command.md", "2 data.md", "3 results.md",
        "projector/haptic/tensors.tsv", "projector/haptic/sprite.png",
    }  # fmt: skip
    drawn = (tmp_path / "figures" / "haptic_confusion.png").read_bytes()
    assert (home / "confusion" / "recordings.png").read_bytes() == drawn
