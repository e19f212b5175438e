"""The rank of this process among those that train together, and what the environment says of them.

Lightning's launcher, ``torchrun`` and ``srun`` set environment variables, which every program that
they start inherits, even one that trains alone or only classifies. A rank therefore counts only if
this run trains on as many devices as processes were started (:func:`joining`). Otherwise the
variables are hidden from Lightning, which would wait for the other processes, or write nothing.
"""

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import ClassVar

from tex_lightning.errors import UserError

PARENT = "TEX_LIGHTNING_PARENT"  # number of the process that Lightning starts again for each device
TORCHRUN = "TORCHELASTIC_RUN_ID"
RANKS = ("RANK", "LOCAL_RANK", "JSM_NAMESPACE_RANK", "WORLD_SIZE", "NODE_RANK", "GROUP_RANK")
SLURM = ("SLURM_PROCID", "SLURM_NTASKS")
PER_NODE = "SLURM_NTASKS_PER_NODE"  # Lightning asks for it; SLURM does not derive it from --ntasks
INTERACTIVE = ("bash", "interactive")  # names of jobs of SLURM in which somebody types commands


def _number(name: str, default: int = 0) -> int:
    """Return a variable as a whole number; the default if it is none, or not set."""
    text = os.environ.get(name, "")
    return int(text) if text.isdecimal() else default


def is_launched() -> bool:
    """Return whether Lightning has started this process for a further device of its parent."""
    return "LOCAL_RANK" in os.environ and _number(PARENT, -1) == os.getppid()


class Process:
    """This process.

    Attributes:
        rank: Its number in the process group of the run; 0 outside of one.
        local: Its number on this machine, which is that of its device; 0 outside of one.
        signalled: Whether SLURM sent SIGUSR1 before a training could queue its job again.
    """

    rank: ClassVar[int] = _number("LOCAL_RANK") if is_launched() else 0
    local: ClassVar[int] = rank
    signalled: ClassVar[bool] = False


def is_torchrun() -> bool:
    """Return whether torchrun has started this process, or one above it."""
    return TORCHRUN in os.environ


def is_rank_zero() -> bool:
    """Return whether this process prints and writes; those that only train do not."""
    return Process.rank == 0


def started_processes() -> int | None:
    """Return how many processes torchrun or a step of SLURM has started; None without one."""
    if is_torchrun():
        return _number("WORLD_SIZE", 1)
    in_step = "SLURM_STEP_ID" in os.environ or _number("SLURM_PROCID") > 0
    tasks = _number("SLURM_STEP_NUM_TASKS", slurm_tasks()) if in_step else 1
    return tasks if tasks > 1 and slurm_tasks() > 1 else None


def slurm_tasks() -> int:
    """Return the number of tasks of SLURM's job or step; 1 where one types commands, or outside."""
    return 1 if os.environ.get("SLURM_JOB_NAME") in INTERACTIVE else _number("SLURM_NTASKS", 1)


def check_started(processes: int) -> None:
    """Reject a training for which another number of processes was started than train together.

    Raises:
        UserError: With the way to start them.
    """
    started, tasks = started_processes(), slurm_tasks()
    if started not in (None, processes) and not is_launched():
        starter = "torchrun" if is_torchrun() else "srun"
        raise UserError(
            f"{starter} has started {started} processes, and this run trains with {processes}: "
            f"give trainer=ddp trainer.devices=NUMBER (and trainer.num_nodes) so that there are "
            f"{started}, or start one process."
        )
    if started is None and tasks > 1 and not is_launched():
        raise UserError(
            f"SLURM's job has {tasks} tasks, and this is a single process: put srun before the "
            "command, with trainer=ddp trainer.devices=NUMBER of each node, or take one task "
            "(srun --ntasks=1)."
        )


@contextmanager
def joining(processes: int) -> Iterator[None]:
    """Let this process take its place among so many that train one network, or be alone (1).

    The rank stays until the next run of this process, so that an error is said once.
    """
    together, number = processes > 1 and started_processes() == processes, 0
    given: dict[str, str] = {}
    hidden, local = {*RANKS, TORCHRUN, *SLURM}, 0
    if is_launched():
        hidden, number = set(), (local := _number("LOCAL_RANK"))
    elif together and is_torchrun():
        hidden, number, local = set(), _number("RANK"), _number("LOCAL_RANK")
    elif together:
        hidden, number, local = {*RANKS}, _number("SLURM_PROCID"), _number("SLURM_LOCALID")
        each = processes // max(1, _number("SLURM_NNODES", 1))
        given = {PER_NODE: str(each)} if PER_NODE not in os.environ else {}
    elif processes > 1:
        os.environ[PARENT] = str(os.getpid())
    Process.rank, Process.local = number, local
    before = {name: os.environ.pop(name) for name in hidden & os.environ.keys()}
    os.environ.update(given)
    if hidden and (said := sys.modules.get("lightning_utilities.core.rank_zero")):
        said.rank_zero_only.rank = number  # which was read when Lightning was imported
    try:
        yield
    finally:
        if not is_launched():
            os.environ.pop(PARENT, None)
        for name in given:
            os.environ.pop(name, None)
        os.environ.update(before)


@contextmanager
def requeueing() -> Iterator[None]:
    """Queue this batch job of SLURM again when it sends SIGUSR1, shortly before it ends the job.

    The last finished epoch is on the disk. Lightning, which leaves a signal alone that is handled,
    would write a checkpoint in the midst of an epoch, and start every later network from it.

    So does SIGTERM if the job is to make way for another (:class:`_MakingWay`).
    """
    if not _can_requeue():
        yield
        return
    known = signal.getsignal(signal.SIGTERM)
    making_way = known if isinstance(known, _MakingWay) else _MakingWay()
    before = {
        signal.SIGUSR1: signal.signal(signal.SIGUSR1, _requeue),
        signal.SIGTERM: signal.signal(signal.SIGTERM, making_way),
    }
    if Process.signalled:
        _requeue()
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def remember_signal() -> None:
    """Let a batch job of SLURM outlive SIGUSR1 until a training can queue it again.

    A job that is to make way for another is queued again at once.
    """
    if _can_requeue():
        signal.signal(signal.SIGUSR1, _remember)
        signal.signal(signal.SIGTERM, _MakingWay())


def _can_requeue() -> bool:
    """Return whether this is a batch job of SLURM, whose SIGUSR1 nobody else handles."""
    typed = os.environ.get("SLURM_JOB_NAME") in INTERACTIVE
    if "SLURM_JOB_ID" not in os.environ or typed or shutil.which("scontrol") is None:
        return False
    alone = threading.current_thread() is threading.main_thread()
    return alone and signal.getsignal(signal.SIGUSR1) in (signal.SIG_DFL, _remember)


def _remember(*_: object) -> None:
    Process.signalled = True


def _requeue(*_: object) -> None:
    Process.signalled = False
    if is_rank_zero():
        subprocess.call(["scontrol", "requeue", os.environ["SLURM_JOB_ID"]])


class _MakingWay:
    """Handler of SIGTERM, which queues this job again if SLURM preempts it, and then ends it.

    SLURM itself requeues what it has ended, but not a job that ends within the grace time of its
    partition, as this one does.
    """

    def __init__(self) -> None:
        self.before = signal.getsignal(signal.SIGTERM)

    def __call__(self, number: int, frame: FrameType | None) -> None:
        if is_rank_zero() and _is_preempted():
            _requeue()
        if callable(self.before):
            self.before(number, frame)
        elif signal.getsignal(number) is self:  # else Lightning ends after the current step
            signal.signal(number, signal.SIG_DFL)
            signal.raise_signal(number)


def _is_preempted() -> bool:
    """Return whether SLURM has chosen this job to make way, and has not queued it yet."""
    asked = ["scontrol", "show", "job", os.environ["SLURM_JOB_ID"]]
    said = subprocess.run(asked, capture_output=True, text=True, check=False).stdout
    return "JobState=RUNNING" in said and re.search(r"\bPreemptTime=\d", said) is not None
