"""Two processes on the CPU beside one: the same weights and votes; all end together.

Lightning starts the second process by the command line of the first, so these runs are real ones.
"""

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from tex_lightning.config import CONF

TWO = ["trainer=ddp", "trainer.accelerator=cpu", "trainer.devices=2"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(CONF.parent), "OMP_NUM_THREADS": "1"}


# Nothing in these networks differs with the number of processes
SAME = [
    *("model.haptic.norm=lrn", "model.haptic.dropout=0", "model.haptic.width=0.1"),
    *("model.visual.norm=lrn", "model.visual.dropout=0", "model.visual.width=0.1"),
]


def command(tiny: list[str], cache: Path, directory: Path, *arguments: str) -> list[str]:
    folders = [f"data.cache_dir={cache}", f"hydra.run.dir={directory}"]
    return ["-m", "tex_lightning", *tiny, *SAME, *folders, *TWO, *arguments]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *arguments], env=ENVIRONMENT, capture_output=True, text=True, timeout=200
    )


def weights(directory: Path, kind: str) -> dict[str, torch.Tensor]:
    path = directory / "checkpoints" / f"{kind}.ckpt"
    return torch.load(path, weights_only=True)["state_dict"]


def votes(directory: Path, kind: str) -> list[tuple[str, ...]]:
    with (directory / "predictions" / f"{kind}.csv").open() as stream:
        keys = ("haptic", "image", "predicted", "correct_fragments")
        return [tuple(row.get(key, "") for key in keys) for row in csv.DictReader(stream)]


def validated(directory: Path, kind: str) -> torch.Tensor:
    """Loss and metrics (epochs, 3) on three samples, which two processes share unevenly."""
    names = "loss", "fragment_accuracy", "vote_accuracy"
    with (directory / "metrics" / kind / "metrics.csv").open() as stream:
        rows = [row for row in csv.DictReader(stream) if row["val/loss"]]
    assert len(rows) == 2
    return torch.tensor([[float(row[f"val/{name}"]) for name in names] for row in rows])


def written(directory: Path) -> list[str]:
    """All files; those of events by their kind, since their names hold time and process."""
    paths = {str(path.relative_to(directory)) for path in directory.rglob("*.*")}
    return sorted({path.partition(".tfevents")[0] for path in paths})


@pytest.fixture
def alone(run_once, tiny):
    """Make a run in one process."""
    return lambda model: run_once(*tiny, *SAME, f"model={model}", "trainer.accelerator=cpu")


@pytest.mark.parametrize(
    ("model", "kinds"),
    [
        ("haptic", ["haptic"]),
        pytest.param("fusion", ["haptic", "visual", "fusion"], marks=pytest.mark.slow),
    ],
)
def test_two_processes_train_as_one_does(alone, tiny, cache, tmp_path, model, kinds):
    one, two = alone(model), tmp_path / "two"
    finished = run(*command(tiny, cache, two, f"model={model}"))
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr.count("Results in") == 1
    for kind in kinds:
        left, right = weights(one, kind), weights(two, kind)
        assert left.keys() == right.keys()
        for key in left:
            if key.endswith(".directions"):  # whose signs rounding may turn
                continue
            torch.testing.assert_close(left[key], right[key], rtol=1e-5, atol=1e-5)
        assert votes(one, kind) == votes(two, kind)
        torch.testing.assert_close(validated(two, kind), validated(one, kind), rtol=1e-3, atol=1e-4)
    assert written(one) == written(two)


@pytest.mark.slow
def test_torchrun_starts_all_processes_and_rank_zero_alone_speaks(alone, tiny, cache, tmp_path):
    starter = ["-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    arguments = command(tiny, cache, tmp_path / "run", "model=haptic")
    finished = run(*starter, *arguments)
    assert finished.returncode == 0, finished.stderr
    assert finished.stderr.count("Results in") == 1
    assert votes(alone("haptic"), "haptic") == votes(tmp_path / "run", "haptic")
    folder = f"hydra.run.dir={tmp_path / 'run'}"
    refused = run(*starter, *(each for each in arguments if each != folder))
    assert refused.stderr.count("share a run folder; give hydra.run.dir") == 1


@pytest.mark.slow
def test_two_tasks_of_srun_train_as_one_process_does(alone, tiny, cache, tmp_path):
    step = {"SLURM_JOB_ID": str(os.getpid()), "SLURM_STEP_ID": "0", "SLURM_NNODES": "1"}
    step |= dict.fromkeys(("SLURM_NTASKS", "SLURM_STEP_NUM_TASKS", "SLURM_NTASKS_PER_NODE"), "2")
    arguments = command(tiny, cache, tmp_path / "run", "model=haptic")
    tasks = [
        subprocess.Popen(
            [sys.executable, *arguments], text=True, stderr=subprocess.PIPE,
            env={**ENVIRONMENT, **step, "SLURM_NODEID": "0", "RANK": "",
                 **dict.fromkeys(("SLURM_PROCID", "SLURM_LOCALID"), rank)},
        )
        for rank in ("0", "1")
    ]  # fmt: skip
    said = [task.communicate(timeout=200)[1] for task in tasks]
    assert [task.returncode for task in tasks] == [0, 0], said
    assert [text.count("Results in") for text in said] == [1, 0]
    assert votes(alone("haptic"), "haptic") == votes(tmp_path / "run", "haptic")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["model.haptic.fit.batch_size=7"], "is 7, but 2 processes share every batch"),
        (["trainer.num_nodes=2"], "start the command with srun or torchrun"),
        (["task=profile"], "several devices are used by task=fit and task=crossval"),
    ],
)
def test_what_cannot_be_shared_is_refused(cli, tmp_path, arguments, message):
    outcome = cli("model=haptic", *TWO, *arguments, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert message in outcome.err
    assert not (tmp_path / "settings.json").exists()


def test_flags_of_the_trainer_are_passed_on_or_refused(cli, tiny, tmp_path):
    wrong = "trainer.gradient_clip_vall=1"
    outcome = cli("model=haptic", *tiny, wrong, f"hydra.run.dir={tmp_path / 'a'}")
    assert outcome.status == 2
    assert "unexpected keyword argument 'gradient_clip_vall'" in outcome.err
    clipped = ["trainer.gradient_clip_val=1e-12", "logger=csv"]
    outcome = cli("model=haptic", *tiny, *SAME, *clipped, f"hydra.run.dir={tmp_path / 'b'}")
    assert outcome.status == 0, outcome.err
