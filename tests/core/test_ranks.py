"""A rank in the environment counts only among the processes that train one network together."""

import json
import os
import signal
import subprocess
import sys

import pytest
import torch
from lightning import Callback

from tex_lightning import cli as command
from tex_lightning.config import CONF
from tex_lightning.core.console import console
from tex_lightning.core.devices import pick_device
from tex_lightning.core.ranks import (
    PARENT,
    Process,
    check_started,
    is_launched,
    is_rank_zero,
    joining,
    remember_signal,
    requeueing,
    started_processes,
)
from tex_lightning.errors import UserError

LEFT = [  # by programs above this one
    {"RANK": "1", "WORLD_SIZE": "2"},
    {"LOCAL_RANK": "1"},
    {"RANK": ""},
    {"RANK": "x", "LOCAL_RANK": "", "SLURM_PROCID": "", "JSM_NAMESPACE_RANK": "3"},
]
STEP = {"SLURM_STEP_ID": "0", "SLURM_STEP_NUM_TASKS": "2", "SLURM_NTASKS": "2", "SLURM_PROCID": "1",
        "SLURM_LOCALID": "1"}  # fmt: skip
TORCHRUN = {"TORCHELASTIC_RUN_ID": "a", "RANK": "1", "WORLD_SIZE": "2", "LOCAL_RANK": "1"}
READ = ("RANK", "PROCID", "NTASKS", "WORLD_SIZE", "RUN_ID")  # by Lightning
BATCH = {"SLURM_JOB_ID": "7", "SLURM_NTASKS": "2", "SLURM_PROCID": "0"}


@pytest.fixture(autouse=True)
def bare(monkeypatch):
    """An environment without such variables, and afterwards a process without a rank."""
    for name in list(os.environ):
        if "RANK" in name or name.startswith(("SLURM", "WORLD", "TORCHELASTIC")):
            monkeypatch.delenv(name)
    yield
    Process.rank = Process.local = 0


def give(monkeypatch, variables):
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    return {**os.environ}


@pytest.mark.parametrize("variables", [*LEFT, STEP, TORCHRUN, BATCH], ids=str)
def test_who_trains_alone_has_no_rank_and_lightning_sees_none(monkeypatch, variables):
    before = give(monkeypatch, variables)
    with joining(1):
        assert is_rank_zero()
        assert [name for name in variables if name.endswith(READ) and name in os.environ] == []
    assert before == {**os.environ}


@pytest.mark.parametrize("variables", [STEP, TORCHRUN], ids=["srun", "torchrun"])
def test_who_was_started_beside_others_has_its_rank_where_they_train_together(
    monkeypatch, variables
):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: 4)
    before = give(monkeypatch, variables)
    assert started_processes() == 2
    check_started(2)
    per_node = (
        {"SLURM_NTASKS_PER_NODE": "2"} if variables is STEP else {}
    )  # without --ntasks-per-node
    with joining(2):
        assert not is_rank_zero()
        assert {**before, **per_node} == {**os.environ}
        assert pick_device("cuda") == torch.device("cuda", 1)  # before Lightning has chosen it
    assert before == {**os.environ}
    with pytest.raises(UserError, match=r"has started 2 processes.*trains with 1: .*trainer=ddp"):
        check_started(1)


def test_a_process_that_lightning_started_is_known_by_its_parent(monkeypatch):
    give(monkeypatch, {"LOCAL_RANK": "1", PARENT: str(os.getppid())})
    assert is_launched()
    monkeypatch.setenv(PARENT, "1000000000")  # of a program above the parent
    assert not is_launched()
    monkeypatch.delenv("LOCAL_RANK")
    monkeypatch.delenv(PARENT)
    with joining(2):
        assert os.environ[PARENT] == str(os.getpid())
    assert PARENT not in os.environ


def test_tasks_without_srun_are_told_the_cure_and_a_shell_or_a_single_task_is_none(monkeypatch):
    give(monkeypatch, BATCH)
    assert started_processes() is None
    with pytest.raises(UserError, match="has 2 tasks, and this is a single process: put srun"):
        check_started(1)
    monkeypatch.setenv("SLURM_JOB_NAME", "bash")
    check_started(1)
    give(monkeypatch, {"SLURM_JOB_NAME": "train", "SLURM_NTASKS": "1"})
    check_started(1)
    for processes in (1, 2):  # Lightning would write checkpoints of its own, or wait for a task
        with joining(processes):
            assert "SLURM_NTASKS" not in os.environ


@pytest.fixture
def queue(monkeypatch, tmp_path):
    """A stand-in for scontrol; returns the file of what it was asked."""
    asked, program = tmp_path / "asked", tmp_path / "bin" / "scontrol"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\necho "$@" >> "{asked}"\n')
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=os.pathsep)
    return asked


class SignalOnce(Callback):
    """Signals this process in the midst of the first epoch, as SLURM does before a time limit."""

    def on_train_batch_end(self, trainer, module, outputs, batch, batch_idx):
        if (trainer.current_epoch, batch_idx) == (0, 0):
            signal.raise_signal(signal.SIGUSR1)


def test_a_job_of_slurm_that_is_told_to_end_is_queued_again(
    monkeypatch, queue, cli, tiny, tmp_path
):
    give(monkeypatch, {**BATCH, "SLURM_NTASKS": "1", "SLURM_JOB_NAME": "train"})
    added = f"+callbacks.signal._target_={__name__}.SignalOnce"
    run = [*tiny, "model=haptic", "trainer.accelerator=cpu", "logger=csv"]
    outcome = cli(*run, added, f"trusted=[{__name__}]", f"hydra.run.dir={tmp_path / 'run'}")
    assert outcome.status == 0, outcome.err
    assert queue.read_text() == "requeue 7\n"
    assert not [*tmp_path.rglob("hpc_ckpt*")]  # Lightning's, where every further network starts
    assert signal.getsignal(signal.SIGUSR1) is signal.SIG_DFL


@pytest.mark.parametrize("name", ["rank", "shell", "handled"])
def test_only_rank_zero_of_a_batch_job_queues_it_again(monkeypatch, queue, name):
    give(monkeypatch, {**BATCH, "SLURM_JOB_NAME": "bash" if name == "shell" else "train"})
    said, handler = [], {"rank": signal.SIG_DFL}.get(name, lambda *_: said.append(1))
    monkeypatch.setattr(Process, "rank", int(name == "rank"))
    before = signal.signal(signal.SIGUSR1, handler)
    try:
        with requeueing():
            signal.raise_signal(signal.SIGUSR1)
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert (len(said), queue.exists()) == (int(name != "rank"), False)


PREEMPTED = "JobId=7 JobState=RUNNING PreemptEligibleTime=2026-11-27T12:00:00 PreemptTime={}"


def say_preempted(tmp_path, when):
    """Let the stand-in for scontrol say when the job was chosen to make way."""
    with (tmp_path / "bin" / "scontrol").open("a") as program:
        program.write(f'[ "$1" = show ] && echo "{PREEMPTED.format(when)}"\n')


@pytest.mark.parametrize(("when", "requeues"), [("2026-11-27T12:00:10", 1), ("None", 0)])
def test_a_job_that_is_to_make_way_is_queued_again_before_it_ends(
    monkeypatch, queue, tmp_path, when, requeues
):
    """SLURM requeues no job that ends within the grace time of its partition."""
    give(monkeypatch, {**BATCH, "SLURM_JOB_NAME": "train"})
    say_preempted(tmp_path, when)
    ended = []
    before = signal.signal(signal.SIGTERM, lambda *_: ended.append(1))
    try:
        with requeueing():
            signal.raise_signal(signal.SIGTERM)
            assert ended == [1]
        assert queue.read_text().splitlines() == ["show job 7", *["requeue 7"] * requeues]
        signal.raise_signal(signal.SIGTERM)
        assert ended == [1, 1]
    finally:
        signal.signal(signal.SIGTERM, before)


SIGNALLED = """
import runpy, signal, sys

class Finder:
    def find_spec(self, name, *_):
        if name == "tex_lightning.cli":
            signal.raise_signal(signal.NUMBER)

sys.meta_path.insert(0, Finder())
sys.argv[1:] = ["--help"]
runpy.run_module("tex_lightning", run_name="__main__")
"""


@pytest.mark.parametrize("name", ["train", "bash"])
def test_a_signal_during_the_imports_ends_no_job(monkeypatch, queue, name):
    give(monkeypatch, {**BATCH, "SLURM_JOB_NAME": name, "PYTHONPATH": str(CONF.parent)})
    finished = signalled_during_imports("SIGUSR1")
    assert finished.returncode == (0 if name == "train" else -signal.SIGUSR1), finished.stderr
    assert not queue.exists()  # until a training begins


def signalled_during_imports(number):
    started = [sys.executable, "-c", SIGNALLED.replace("NUMBER", number)]
    return subprocess.run(started, capture_output=True, text=True, check=False)


def test_a_job_that_is_to_make_way_during_the_imports_is_queued_again(monkeypatch, queue, tmp_path):
    give(monkeypatch, {**BATCH, "SLURM_JOB_NAME": "train", "PYTHONPATH": str(CONF.parent)})
    say_preempted(tmp_path, "2026-11-27T12:00:10")
    finished = signalled_during_imports("SIGTERM")
    assert finished.returncode == -signal.SIGTERM, finished.stderr
    assert queue.read_text().splitlines() == ["show job 7", "requeue 7"]


def test_a_signal_of_before_the_training_queues_the_job_once(monkeypatch, queue):
    give(monkeypatch, {**BATCH, "SLURM_JOB_NAME": "train"})
    numbers = signal.SIGUSR1, signal.SIGTERM
    before = {number: signal.signal(number, signal.SIG_DFL) for number in numbers}
    try:
        remember_signal()
        making_way = signal.getsignal(signal.SIGTERM)
        signal.raise_signal(signal.SIGUSR1)
        for _ in range(2):
            with requeueing():
                assert queue.read_text() == "requeue 7\n"
                assert signal.getsignal(signal.SIGTERM) is making_way  # which ends by default
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@pytest.mark.slow
def test_a_run_below_another_one_writes_its_results(surfaces, cache, tmp_path):
    """In a process of its own, as Lightning reads the variables when it is imported."""
    given = ["experiment=few/haptic", "data=folder", f"data.root={surfaces}", "logger=csv"]
    given += [f"hydra.run.dir={tmp_path}", f"data.cache_dir={cache}"]
    left = {"RANK": "", "LOCAL_RANK": "1", "WORLD_SIZE": "2", "PYTHONPATH": str(CONF.parent)}
    finished = subprocess.run(
        [sys.executable, "-m", "tex_lightning", *given],
        env={**os.environ, **left}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (finished.returncode, "Results in" in finished.stderr) == (0, True), finished.stderr
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["networks"]["haptic"]["test_samples"] == 3
    assert (tmp_path / "checkpoints" / "haptic.ckpt").is_file()


@pytest.mark.parametrize("variables", [LEFT[2], STEP], ids=["empty", "srun"])
def test_each_process_predicts_for_itself(monkeypatch, variables, cli, surfaces, bands):
    give(monkeypatch, variables)
    file = surfaces / "alpha" / "haptic" / "alpha_0.wav"
    outcome = cli("task=predict", f"checkpoint={bands}", f"haptic={file}")
    assert outcome.status == 0, outcome.err
    assert json.loads(outcome.out)["label"] == "alpha"


@pytest.mark.parametrize("variables", [STEP, TORCHRUN, BATCH], ids=["srun", "torchrun", "batch"])
def test_a_training_that_does_not_fit_what_was_started_is_one_sentence(
    monkeypatch, variables, cli, tiny, tmp_path
):
    give(monkeypatch, variables)
    outcome = cli("model=haptic", *tiny, f"hydra.run.dir={tmp_path}")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1)
    assert "trainer=ddp" in outcome.err


def test_another_rank_waits_for_the_end_and_then_speaks_for_itself(monkeypatch, capfd):
    """Torchrun ends all processes as soon as one does: rank zero is to speak first."""
    waited = []
    monkeypatch.setattr("time.sleep", waited.append)
    assert command.complain("The file is not here.") == 2
    assert not waited
    monkeypatch.setattr(Process, "rank", 1)
    monkeypatch.setattr(console, "quiet", True)
    assert command.complain("The file is not here.") == 2
    assert waited == [command.PATIENCE]
    assert capfd.readouterr().err.count("Error: The file is not here.") == 2
