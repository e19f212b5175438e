"""What the chapter on clusters promises of several nodes, accounting and preemption.

``python -m benchmarks nodes`` (as root on Debian: it installs ``slurmdbd`` and ``mariadb-server``,
too), ``--only=preempted`` as of the benchmark ``slurm``

Two nodes of a SLURM on this machine, each a ``slurmd`` with an address of its own. Trainings have
to end with the weights and votes, to the last bit, of those with as many processes on one node.
Files are those of one machine: that the run folder is on a disk that all nodes share is given.
"""

import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import torch

from benchmarks._cluster import NODES, URGENT, WARNED, asked, until
from benchmarks._commands import environment
from benchmarks.slurm import (
    FUSION,
    LONG,
    PATIENCE,
    SRUN,
    SWEEP,
    TORCHRUN,
    Bench,
    _again,
    _done,
    _expect,
    _first_of_array,
    _requeue,
    _rows,
    _signal,
    checked,
)

DDP = ("model=haptic", *LONG, "trainer=ddp", "trainer.accelerator=cpu", "trainer.num_nodes=2")
SPREAD = (*DDP, "trainer.devices=1")
FOUR = (*DDP, "trainer.devices=2")
ALL = ("--nodes=2", "--exclusive")
# nothing in this network differs with the number of processes
ALIKE = ("model.haptic.norm=lrn", "model.haptic.dropout=0")
NEAR = 1e-5  # of its weights


class Nodes(Bench):
    """The checks, each of which returns what is wrong, or nothing."""

    def ddp_of_two_nodes(self) -> str:
        """A task on each node is as two processes on one."""
        return self._spread("spread", SPREAD, 1) or self.same(self._whole_ddp(), "spread")

    def ddp_of_two_tasks_on_each_node(self) -> str:
        """Two tasks on each node are as four processes on one."""
        torchrun = (*TORCHRUN[:-1], "--nproc-per-node=4")
        one = (*DDP[:-1], "trainer.devices=4")
        said = self.plain([*torchrun, *self.arguments("four", one)])
        wrong = _expect(said.returncode == 0, said.stderr) or self._spread("four_spread", FOUR, 2)
        return wrong or self.same(self.folder / "runs" / "four", "four_spread")

    def ddp_of_two_nodes_beside_one_process(self) -> str:
        """A task on each node is as one process, but for rounding."""
        one = self.undisturbed("one", ("model=haptic", *ALIKE))
        given = (*(each for each in SPREAD if each not in LONG), *ALIKE)
        return self._spread("alike", given, 1) or _near(one, self.folder / "runs" / "alike")

    def _spread(self, case: str, given: tuple[str, ...], each: int) -> str:
        tasks = ("--nodes=2", f"--ntasks-per-node={each}", sys.executable)
        done = self.plain([*SRUN, *tasks, *self.arguments(case, given)])
        return _expect(done.returncode == 0 and done.stderr.count("Results in") == 1, done.stderr)

    def too_few_nodes(self) -> str:
        """Two nodes of which the command knows one are refused with the cure."""
        given = self.arguments("few", (*DDP[:-1], "trainer.devices=1"))
        done = self.plain([*SRUN, "--nodes=2", sys.executable, *given])
        cure = "srun has started 2 processes, and this run trains with 1: give trainer=ddp"
        return _expect(done.returncode != 0 and cure in done.stderr, done.stderr)

    def torchrun_on_two_nodes(self) -> str:
        """A torchrun for each node trains as srun does."""
        with socket.socket() as free:
            free.bind((NODES[0], 0))
            port = free.getsockname()[1]
        start = (*TORCHRUN[:3], "--nnodes=2", "--nproc-per-node=1", f"--master-addr={NODES[0]}")
        runs = [
            subprocess.Popen(
                [*start, f"--master-port={port}", f"--node-rank={rank}",
                 *self.arguments("torchrun_spread", SPREAD)],
                cwd=self.folder, env=environment(), stderr=subprocess.PIPE, text=True,
            )
            for rank in range(len(NODES))
        ]  # fmt: skip
        said = "".join(run.communicate(timeout=PATIENCE)[1] for run in runs)
        done = not any(run.returncode for run in runs) and said.count("Results in") == 1
        return _expect(done, said) or self.same(self._whole_ddp(), "torchrun_spread")

    def requeued_on_two_nodes(self) -> str:
        """Both tasks are requeued in their midst."""
        return self._interrupted("requeued_spread", SPREAD, _requeue, "--nodes=2")

    def signalled_on_two_nodes(self) -> str:
        """Both tasks get SIGUSR1 and queue their job once."""
        return self._interrupted("usr1_spread", SPREAD, _signal, "--nodes=2")

    def node_lost(self) -> str:
        """The second node fails in the midst of a training, and comes back."""
        return self._interrupted("lost", SPREAD, _lose_node, "--nodes=2")

    def preempted(self) -> str:
        """A FusionNet makes way for an urgent job and goes on."""
        return self._interrupted("preempted", FUSION, _preempt)

    def warned(self) -> str:
        """A FusionNet that is told before it has to make way goes on, too."""
        return self._interrupted("warned", FUSION, _preempt, f"--partition={WARNED}")

    def warned_on_two_nodes(self) -> str:
        """Both tasks are told before they have to make way."""
        more = ("--nodes=2", f"--partition={WARNED}")
        return self._interrupted("warned_spread", SPREAD, _preempt, *more)

    def preempted_on_two_nodes(self) -> str:
        """Both tasks make way for an urgent job and go on."""
        return self._interrupted("preempted_spread", SPREAD, _preempt, "--nodes=2")

    def preempted_sweep(self) -> str:
        """The jobs of a sweep make way for an urgent one, go on, and the sweep waits for them."""
        return self._preempted_sweep("swept")

    def warned_sweep(self) -> str:
        """The same, told before."""
        return self._preempted_sweep("told", f"hydra.launcher.partition={WARNED}")

    def _preempted_sweep(self, case: str, *more: str) -> str:
        given = ("model=haptic", LONG[0], "data.test_fold=2,3", *more)
        path = self.folder / "runs" / case
        sweep = [*self.arguments("unused", (*SWEEP, *given)), f"hydra.sweep.dir={path}"]
        first = subprocess.Popen(
            [sys.executable, *sweep], cwd=self.folder, env=environment(), text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        if not self.in_midst(path / "0"):
            return "job 0 did not begin"
        jobs = [f"{_first_of_array()[:-2]}_{number}" for number in range(2)]
        _preempt(jobs[0])
        again = [_again(job) for job in jobs]
        said, _ = first.communicate(timeout=PATIENCE)
        whole = self.undisturbed("long", (*given[:2], "data.test_fold=2"))
        wrong = self.same(whole, f"{case}/0") or ("" if all(again) else "was not requeued")
        return wrong or _expect(first.returncode == 0 and _done(_rows(path)) == 2, said)

    def accounted_sweep(self) -> str:
        """A sweep with a failing job ends as without, and all of its jobs end in the account."""
        status, said, rows = self.sweep("accounted", "model=haptic", "data.test_fold=0,1,2")
        wrong = _expect(status == 1 and _done(rows) == 2, said)
        return wrong or _expect(until(_accounted, 30), asked(*SACCT))


SACCT = ("sacct", "-nXP", "-o", "JobName,State")


def _accounted() -> bool:
    """Whether all jobs have an end in SLURM's account."""
    states = asked(*SACCT).splitlines()
    return bool(states) and not any(state.endswith("RUNNING") for state in states)


def _preempt(job: str) -> None:
    """Let an urgent job take both nodes for a few seconds."""
    urgent = ("sbatch", f"--partition={URGENT}", *ALL, "--output=/dev/null", "--wrap=sleep 5")
    asked(*urgent)
    until(lambda: "PENDING" in asked("squeue", "-h", "-j", job, "-o", "%T"), 60)


def _lose_node(job: str) -> None:
    """Take the second node away until the job waits for it."""
    change = ("scontrol", "update", f"NodeName={NODES[1]}")
    asked(*change, "State=DOWN", "Reason=check")
    until(lambda: "PENDING" in asked("squeue", "-h", "-j", job, "-o", "%T"), 60)
    asked(*change, "State=RESUME")


def _near(one: Path, other: Path) -> str:
    """Which weights of two runs differ by more than rounding."""
    left, right = (
        torch.load(run / "checkpoints" / "haptic.ckpt", weights_only=True)["state_dict"]
        for run in (one, other)
    )
    apart = {
        name: float((left[name] - right[name]).abs().max())
        for name in left
        if not name.endswith(".directions")
    }  # whose signs rounding may turn
    return ", ".join(f"{name} by {most:.2g}" for name, most in apart.items() if most > NEAR)


CHECKS = (
    Nodes.ddp_of_two_nodes, Nodes.ddp_of_two_tasks_on_each_node,
    Nodes.ddp_of_two_nodes_beside_one_process, Nodes.too_few_nodes, Nodes.torchrun_on_two_nodes,
    Nodes.requeued_on_two_nodes, Nodes.signalled_on_two_nodes, Nodes.node_lost, Nodes.preempted,
    Nodes.warned, Nodes.warned_on_two_nodes, Nodes.preempted_on_two_nodes, Nodes.preempted_sweep,
    Nodes.warned_sweep, Nodes.accounted_sweep, Bench.requeue, Bench.time_limit,
    Bench.sweep_of_folds, Bench.sweep_with_a_requeued_job, Bench.sweep_with_a_cancelled_job,
)  # fmt: skip


def measure(only: str = "") -> dict[str, Any]:
    """Whether each check holds, and how long it takes.

    Raises:
        RuntimeError: If one does not.
    """
    return checked(Nodes, CHECKS, only, accounting=True)
