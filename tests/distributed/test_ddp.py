"""Two processes on the CPU beside one: the same batches, weights and votes."""

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from tex_lightning.__main__ import CONF
from tex_lightning.distributed.team import Team
from tex_lightning.errors import UserError
from tex_lightning.learning import train
from tex_lightning.learning.haptic import HapticModule

TWO = ["trainer=ddp", "trainer.accelerator=cpu", "trainer.devices=2"]


def tiny(surfaces: Path, directory: Path) -> list[str]:
    return [
        "data=folder",
        f"data.root={surfaces}",
        "data.half_scale=false",
        "debug=tiny",
        "trainer.threads=1",
        f"hydra.run.dir={directory}",
    ]


def same_for_all(kind: str) -> list[str]:
    """Nothing that differs with the number of processes, and small."""
    section = f"model.{kind}"
    return [f"{section}.norm=lrn", f"{section}.dropout=0", f"{section}.width=0.1"]


def weights(directory: Path, kind: str) -> dict[str, torch.Tensor]:
    path = directory / "checkpoints" / f"{kind}.ckpt"
    return torch.load(path, weights_only=True)["state_dict"]


def votes(directory: Path, kind: str) -> list[tuple[str, ...]]:
    with (directory / "predictions" / f"{kind}.csv").open() as stream:
        keys = ("haptic", "image", "predicted", "correct_fragments")
        return [tuple(row[key] for key in keys) for row in csv.DictReader(stream)]


def written(directory: Path) -> list[str]:
    """All files; those of events by their kind, since their names hold time and process."""
    paths = (str(path.relative_to(directory)) for path in directory.rglob("*.*"))
    return sorted(path.partition(".tfevents")[0] for path in paths)


def losses(directory: Path, kind: str) -> list[float]:
    events = EventAccumulator(str(directory / "tensorboard" / kind))
    events.Reload()
    return [event.value for tag in ("train/loss", "val/loss") for event in events.Scalars(tag)]


def test_two_processes_train_three_networks_as_one_does(cli, surfaces, tmp_path):
    common = ["model=fusion", *same_for_all("haptic"), *same_for_all("visual")]
    one, two = tmp_path / "one", tmp_path / "two"
    assert cli(*common, "trainer.accelerator=cpu", *tiny(surfaces, one)).status == 0
    outcome = cli(*common, *TWO, *tiny(surfaces, two))
    assert outcome.status == 0, outcome.err
    assert outcome.err.count("Results in") == 1
    for kind in ("haptic", "visual", "fusion"):
        left, right = weights(one, kind), weights(two, kind)
        assert left.keys() == right.keys()
        for key in left:
            torch.testing.assert_close(left[key], right[key], rtol=1e-5, atol=1e-5)
        assert losses(one, kind) == pytest.approx(losses(two, kind), rel=1e-4)
        assert votes(one, kind) == votes(two, kind)
    assert written(one) == written(two)


@pytest.mark.slow
def test_two_folds_of_the_default_recipe_learn_easy_surfaces(cli, surfaces, tmp_path):
    recipe = ["model.haptic.fit.epochs=2", "model.haptic.fit.steps_per_epoch=25"]
    more = ["model.haptic.fit.batch_size=12", "model.haptic.width=0.25", "logger=csv"]
    folds = ["task=crossval", "crossval.only=[0,1]", "model=haptic"]
    outcome = cli(*folds, *recipe, *more, *tiny(surfaces, tmp_path), *TWO)
    assert outcome.status == 0, outcome.err
    for fold in (0, 1):
        found = [row[2] for row in votes(tmp_path / "folds" / str(fold), "haptic")]
        assert found == ["alpha", "beta", "gamma"]


def test_ctrl_c_ends_all_and_one_process_goes_on_to_the_same_weights(
    cli, surfaces, tmp_path, monkeypatch
):
    common = ["model=haptic", *same_for_all("haptic"), "model.haptic.fit.epochs=3", "logger=csv"]
    whole, stopped = tmp_path / "whole", tmp_path / "stopped"
    assert cli(*common, *tiny(surfaces, whole)).status == 0
    original = HapticModule.training_step

    def interrupted(self, batch, batch_idx):
        if self.current_epoch == 1 and batch_idx == 1:
            raise KeyboardInterrupt  # in rank zero only: the other is a process of its own
        return original(self, batch, batch_idx)

    handler = signal.getsignal(signal.SIGINT)
    with monkeypatch.context() as patch:
        patch.setattr(HapticModule, "training_step", interrupted)
        outcome = cli(*common, *TWO, *tiny(surfaces, stopped))
    signal.signal(signal.SIGINT, handler)  # Lightning ignores it from the first Ctrl-C on
    assert outcome.status == 130
    assert outcome.err.count("goes on after the last finished epoch") == 1
    assert Team.current is None
    assert cli(*common, *tiny(surfaces, stopped)).status == 0
    left, right = weights(whole, "haptic"), weights(stopped, "haptic")
    for key in left:
        torch.testing.assert_close(left[key], right[key], rtol=1e-5, atol=1e-5)


def test_what_one_process_complains_of_ends_all(cli, surfaces, tmp_path, monkeypatch):
    def refuse(last):
        raise UserError("File A is bad; mend it.")  # in rank zero only

    monkeypatch.setattr(train, "_check_resumable", refuse)
    outcome = cli("model=haptic", *TWO, *tiny(surfaces, tmp_path))
    assert outcome.status == 2
    assert outcome.err.count("Error: File A is bad; mend it.") == 1
    assert "Traceback" not in outcome.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["model.haptic.fit.batch_size=7"], "is 7, but 2 processes share every batch"),
        (["model.haptic.fit.batch_size=2"], "choose a multiple of 2, 4 or more"),
        (["trainer.devices=0"], "trainer.devices is 0: choose 1 or more"),
        (["trainer.num_nodes=2"], "start the command with srun or torchrun"),
        (["trainer.devices=null"], "trainer.devices is null, which takes every GPU"),
        (["task=profile"], "several devices are used when training, not by task=profile"),
    ],
)
def test_what_cannot_be_shared_is_refused(cli, tmp_path, arguments, message):
    outcome = cli("model=haptic", *TWO, *arguments, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert message in outcome.err
    assert not (tmp_path / "settings.json").exists()


def test_a_sweep_is_refused_before_its_first_job(cli, tmp_path):
    outcome = cli("-m", "seed=0,1", *TWO, f"hydra.sweep.dir={tmp_path}/sweep")
    assert outcome.status == 2
    assert outcome.err.count("Error: A sweep runs every job in one process") == 1
    assert not (tmp_path / "sweep").exists()
    swept = ["-m", "trainer.devices=2,4", "trainer.accelerator=cpu", "debug=tiny"]
    assert cli(*swept, f"hydra.sweep.dir={tmp_path}/sweep").status == 1
    assert (
        "A sweep runs every job in one process"
        in (tmp_path / "sweep" / "1" / "failure.json").read_text()
    )


@pytest.mark.slow
def test_torchrun_starts_all_processes_and_rank_zero_alone_speaks(cache, surfaces, tmp_path):
    arguments = ["model=haptic", *TWO, *tiny(surfaces, tmp_path / "run"), f"data.cache_dir={cache}"]
    finished = subprocess.run(
        [
            *(sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"),
            *("-m", "tex_lightning", *arguments),
        ],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(CONF.parent), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
        timeout=100,
    )
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr.count("Results in") == 1
    assert json.loads((tmp_path / "run" / "results.json").read_text())["networks"]["haptic"]
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
