"""Training through the command line: results, resumption, repeatability."""

import json
import math
import re
import shutil
import signal
from pathlib import Path

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

import tex_lightning as tl
from tex_lightning.evaluation.outcomes import optimized_value
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.report.systems import read_systems

NETWORK_KEYS = {
    "fragment_accuracy", "vote_accuracy", "vote_ci95", "correct", "test_samples", "parameters",
    "macs_per_sample", "balanced_accuracy", "macro_f1", "recall", "top_k_accuracy", "latency_ms",
    "fit_seconds", "checkpoint", "calibration",
    "val_loss",
}  # fmt: skip


def weights(directory: Path, kind: str = "haptic") -> dict[str, torch.Tensor]:
    path = directory / "checkpoints" / f"{kind}.ckpt"
    return torch.load(path, weights_only=True)["state_dict"]


def same(left: dict[str, torch.Tensor], right: dict[str, torch.Tensor]) -> bool:
    return left.keys() == right.keys() and all(torch.equal(left[key], right[key]) for key in left)


def test_fusion_trains_three_networks_and_reports_them(fused):
    results = json.loads((fused / "results.json").read_text())
    assert set(results) >= {
        "task", "model", "data", "classes", "seed", "wall_seconds", "environment", "networks",
    }  # fmt: skip
    assert list(results["networks"]) == ["haptic", "visual", "fusion"]
    for network in results["networks"].values():
        assert set(network) == NETWORK_KEYS
        low, high = network["vote_ci95"]
        assert 0 <= low <= network["vote_accuracy"] <= high <= 1
        assert network["vote_accuracy"] == network["correct"] / network["test_samples"]
        assert network["test_samples"] == 3
        assert Path(network["checkpoint"]).is_file()
    assert {path.name for path in fused.iterdir()} >= {
        ".hydra", "checkpoints", "tensorboard", "metrics", "figures", "results.json", "predictions",
    }  # fmt: skip
    assert (fused / "figures" / "fusion_confusion.png").is_file()
    events = EventAccumulator(str(fused / "tensorboard" / "1-haptic"))
    events.Reload()
    assert {"train/loss", "val/loss", "test/vote_accuracy"} <= {*events.Tags()["scalars"]}
    assert any("hparams" in name for name in events.PluginTagToContent("hparams"))
    for path in (fused / "checkpoints").iterdir():
        content = torch.load(path, weights_only=True)
        assert content["hyper_parameters"]["card"]["classes"] == ["alpha", "beta", "gamma"]
        assert "optimizer_states" not in content


@pytest.mark.parametrize(
    ("model", "count"),
    [
        pytest.param("experiment=few/haptic", 30, marks=pytest.mark.slow),
        ("model=mfcc_nb", 30),
        ("model=haptic", 30),
        pytest.param("model=fusion", 60, marks=pytest.mark.slow),
    ],
)
def test_without_a_test_fold_all_recordings_are_trained_on(
    run_once, cli, tiny, surfaces, model, count
):
    run = run_once(model, *tiny, "data.test_fold=null")
    results = json.loads((run / "results.json").read_text())
    for name, network in results["networks"].items():
        assert network["test_samples"] == 0
        assert not {"vote_accuracy", "fragment_accuracy", "vote_ci95", "correct"} & {*network}
        assert network["parameters"] >= 0
        assert network["fit_seconds"] > 0
        assert tl.load(network["checkpoint"]).card.kind == name
    assert optimized_value(results) is None
    card = tl.load(run).card
    assert len(card.trained_on["seen"]) == count
    assert card.training["val_loss"] is None
    assert "not tested" in (run / "report.html").read_text()
    for fold in ((), ("data.test_fold=3",)):
        refused = cli("task=evaluate", f"checkpoint={run}", *tiny[:3], *fold)
        assert refused.status == 2
        assert "it was trained on all that there was" in refused.err


def test_a_validation_fold_stays_one_where_nothing_is_tested(run_once, tiny):
    asked = ("data.test_fold=null", "data.val_fold=1")
    run = run_once("model=haptic", *tiny, *asked)
    results = json.loads((run / "results.json").read_text())
    assert math.isfinite(optimized_value(results))
    table = read_systems([run])
    assert table == []  # there is nothing to compare
    assert tl.load(run).card.temperature != 1


def test_a_finished_run_is_not_trained_again_nor_taken_by_another(cli, tiny, fused, tmp_path):
    run = shutil.copytree(fused, tmp_path / "run")
    before = (run / "checkpoints" / "fusion.ckpt").stat().st_mtime_ns
    assert cli("model=fusion", *tiny, f"hydra.run.dir={run}").status == 0
    assert (run / "checkpoints" / "fusion.ckpt").stat().st_mtime_ns == before
    results = (run / "results.json").read_bytes()
    outcome = cli("model=fusion", "seed=5", *tiny, f"hydra.run.dir={run}")
    assert outcome.status == 2
    assert "another seed; choose another hydra.run.dir" in outcome.err
    outcome = cli("task=inspect", *tiny, f"hydra.run.dir={run}")
    assert outcome.status == 2
    assert "another task; choose another hydra.run.dir" in " ".join(outcome.err.split())
    assert (run / "results.json").read_bytes() == results
    assert "seed=5" not in (run / ".hydra" / "overrides.yaml").read_text()


def test_a_damaged_working_checkpoint_is_said(cli, tiny, tmp_path):
    working = tmp_path / "checkpoints" / "haptic"
    working.mkdir(parents=True)
    (working / "last.ckpt").write_bytes(b"PK\x03\x04")
    outcome = cli("model=haptic", *tiny, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert "is damaged; delete" in outcome.err


def test_given_checkpoints_are_used_and_checked(cli, tiny, fused, tmp_path):
    haptic, visual = (fused / "checkpoints" / f"{kind}.ckpt" for kind in ("haptic", "visual"))
    given = [f"model.fusion.haptic_checkpoint={haptic}", f"model.fusion.visual_checkpoint={visual}"]
    outcome = cli("model=fusion", *given, *tiny, f"hydra.run.dir={tmp_path}/a")
    assert outcome.status == 0, outcome.err
    results = json.loads((tmp_path / "a" / "results.json").read_text())
    assert list(results["networks"]) == ["fusion"]
    leak = cli("model=fusion", *given, "data.test_fold=3", *tiny, f"hydra.run.dir={tmp_path}/b")
    assert leak.status == 2
    assert "has trained on 3 of the 3 test recordings" in leak.err
    assert "data.test_fold=0 as in its training" in leak.err


HAPTIC = ["model=haptic", "model.haptic.fit.epochs=3"]


def test_ctrl_c_then_the_same_command_gives_the_same_weights(
    cli, run_once, tiny, tmp_path, monkeypatch
):
    """Loader processes do not change them, either."""
    run = [*HAPTIC, *tiny, "data.num_workers=2", f"hydra.run.dir={tmp_path}"]
    original = SurfaceModule.training_step

    def interrupted(self, batch, batch_idx):
        if self.current_epoch == 1 and batch_idx == 1:
            raise KeyboardInterrupt
        return original(self, batch, batch_idx)

    handler = signal.getsignal(signal.SIGINT)
    with monkeypatch.context() as patch:
        patch.setattr(SurfaceModule, "training_step", interrupted)
        outcome = cli(*run)
    assert signal.getsignal(signal.SIGINT) is handler  # Lightning would ignore the next one
    assert outcome.status == 130
    assert "goes on after the last finished epoch" in outcome.err
    assert not (tmp_path / "results.json").exists()
    assert cli(*run).status == 0
    assert same(weights(run_once(*HAPTIC, *tiny)), weights(tmp_path))


def test_a_training_that_diverges_after_its_best_epoch_says_so(cli, tiny, tmp_path, monkeypatch):
    original = SurfaceModule.training_step

    def diverging(self, batch, batch_idx):
        return original(self, batch, batch_idx) * (math.nan if self.current_epoch > 0 else 1)

    monkeypatch.setattr(SurfaceModule, "training_step", diverging)
    many = ["model=haptic", "model.haptic.fit.epochs=3", "data.val_fold=1"]
    outcome = cli(*many, *tiny, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    assert "the haptic network diverged; its weights are those of epoch 1" in outcome.err
    assert all(bool(each.isfinite().all()) for each in weights(tmp_path).values())
    assert not re.search(r'points="[^"]*nan', (tmp_path / "report.html").read_text())
