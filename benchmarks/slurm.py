"""What the chapter on clusters promises of one node, on a SLURM of this machine, and torchrun.

``python -m benchmarks slurm`` (as root on Debian: it installs ``slurm-wlm`` and ``munge``)

Prints a line for each check and ends with a traceback if one failed; ``--only=requeue`` takes
those with that word in their name, ``--jobs=50`` is the size of the large sweep. Interrupted
trainings have to end with the weights and votes, to the last bit, of those that were not. There is
no accounting, and the time limit of submitit is played by its signal, as one takes minutes. What
takes several nodes, accounting or preemption is in the benchmark ``nodes``.
"""

import csv
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks._cluster import asked, cluster, until
from benchmarks._commands import command, environment, run
from benchmarks.digests import TINY
from benchmarks.faults import _differences

LONG = ("model.haptic.fit.epochs=40", "model.visual.fit.epochs=4")  # for an end in their midst
TWO = ("trainer=ddp", "trainer.accelerator=cpu", "trainer.devices=2")
FUSION, DDP = ("model=fusion", *LONG), ("model=haptic", *LONG, *TWO)
SWEEP = ("-m", "hydra/launcher=submitit_slurm", "hydra.launcher.timeout_min=10")
SRUN = ("srun", "--kill-on-bad-exit")
TORCHRUN = (sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2")
PATIENCE = 240  # seconds for anything here but the large sweep


@dataclass
class Bench:
    """The checks, in a folder with a few synthetic recordings.

    Attributes:
        folder: Where all runs are.
        jobs: Size of the large sweep.
    """

    folder: Path
    jobs: int

    def arguments(self, case: str, given: tuple[str, ...]) -> list[str]:
        """The command line of a case, after Python's name."""
        data = ("data=folder", f"data.root={self.folder / 'surfaces'}")
        return command(self.folder, case, (*given, *data, *TINY))[1:]

    def undisturbed(self, case: str, given: tuple[str, ...]) -> Path:
        """A run folder that a plain command has finished; made once."""
        path = self.folder / "runs" / case
        if not (path / "results.json").is_file():
            self.plain([sys.executable, *self.arguments(case, given)])
        return path

    def plain(self, arguments: list[str]) -> subprocess.CompletedProcess[str]:
        """A command that has ended, with what it printed."""
        return subprocess.run(
            arguments, cwd=self.folder, env=environment(), capture_output=True, text=True,
            check=False,
        )  # fmt: skip

    def submit(
        self, case: str, given: tuple[str, ...], tasks: int, start: tuple[str, ...], *more: str
    ) -> str:
        """The number of a batch job that runs a case on a node; with more options of sbatch."""
        line = " ".join([*start, sys.executable, *self.arguments(case, given)])
        options = ("--nodes=1", f"--ntasks={tasks}", "--requeue", "--open-mode=append",
                   "--job-name=train", f"--output={self.folder / case}.log")  # fmt: skip
        done = subprocess.run(
            ["sbatch", "--parsable", *options, *more, f"--wrap={line}"],
            cwd=self.folder, env=environment(), capture_output=True, text=True, check=True,
        )  # fmt: skip
        return done.stdout.strip()

    def in_midst(self, path: Path) -> bool:
        """Wait until the first network has finished an epoch, and one more."""
        last = path / "checkpoints" / "haptic" / "last.ckpt"
        begun = until(last.is_file, PATIENCE)
        time.sleep(1)
        return begun and last.is_file()

    def sweep(self, case: str, *given: str) -> tuple[int, str, list[dict[str, str]]]:
        """Exit status, messages and table of a sweep."""
        path = self.folder / "runs" / case
        arguments = [*self.arguments("unused", (*SWEEP, *given)), f"hydra.sweep.dir={path}"]
        done = self.plain([sys.executable, *arguments])
        return done.returncode, done.stdout + done.stderr, _rows(path)

    def same(self, whole: Path, case: str) -> str:
        """In what the run of a case differs from a whole one; empty if in nothing."""
        again = self.folder / "runs" / case
        if not (again / "results.json").is_file():
            return "did not finish"
        return ", ".join(_differences(whole, again))

    # Each check returns what is wrong, or nothing.

    def sweep_of_folds(self) -> str:
        """Each job of a sweep is one of SLURM, and is what it is without."""
        status, said, rows = self.sweep("folds", "model=haptic", "data.test_fold=0,2")
        whole = self.undisturbed("fold", ("model=haptic", "data.test_fold=2"))
        wrong = self.same(whole, "folds/1") or ("sacct" in said and "asks the accounting")
        return wrong or _expect(status == 0 and _done(rows) == 2, said)

    def sweep_with_a_failure(self) -> str:
        """Fold 1 is that of validation: its job fails, is named, and the others finish."""
        status, said, rows = self.sweep("failing", "model=haptic", "data.test_fold=0,1,2")
        named = "Job 1: data.val_fold and data.test_fold are both 1" in said
        return _expect(status == 1 and named and _done(rows) == 2, said)

    def sweep_with_a_cancelled_job(self) -> str:
        """A job that SLURM ends is named, and the same command completes it."""
        given = ("model=haptic", LONG[0], "data.test_fold=2,3")
        sweep = [*self.arguments("unused", (*SWEEP, *given)), "hydra.sweep.dir=runs/cancelled"]
        first = subprocess.Popen(
            [sys.executable, *sweep], cwd=self.folder, env=environment(), text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        path = self.folder / "runs" / "cancelled"
        if not self.in_midst(path / "0"):
            return "job 0 did not begin"
        asked("scancel", _first_of_array())
        said, _ = first.communicate(timeout=PATIENCE)
        if "Job 0: SLURM ended this job (CANCELLED)" not in said or first.returncode != 1:
            return said[-2000:]
        if _done(_rows(path)) != 1:
            return "the other job did not finish"
        again = self.plain([sys.executable, *sweep])
        whole = self.undisturbed("long", (*given[:2], "data.test_fold=2"))
        return self.same(whole, "cancelled/0") or _expect(again.returncode == 0, again.stderr)

    def sweep_with_a_requeued_job(self) -> str:
        """A job of a sweep that gets the signal of submitit goes on."""
        given = ("model=haptic", LONG[0], "data.test_fold=2,3", "hydra.launcher.max_num_timeout=1")
        sweep = [*self.arguments("unused", (*SWEEP, *given)), "hydra.sweep.dir=runs/signalled"]
        first = subprocess.Popen(
            [sys.executable, *sweep], cwd=self.folder, env=environment(), text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        if not self.in_midst(self.folder / "runs" / "signalled" / "0"):
            return "job 0 did not begin"
        job = _first_of_array()
        asked("scancel", "--signal=USR2", job)
        if not _again(job):
            return "was not requeued"
        said, _ = first.communicate(timeout=PATIENCE)
        whole = self.undisturbed("long", (*given[:2], "data.test_fold=2"))
        return self.same(whole, "signalled/0") or _expect(first.returncode == 0, said)

    def sweep_of_many_jobs(self) -> str:
        """As many small jobs as asked for, two at a time."""
        steps = f"model.haptic.fit.steps_per_epoch=range(1,{self.jobs + 1})"
        given = ("model=haptic", "hydra.launcher.array_parallelism=2", steps)
        status, said, rows = self.sweep("many", *given)
        return _expect(status == 0 and _done(rows) == self.jobs, said)

    def ddp_of_srun(self) -> str:
        """Two tasks train one network, and rank zero speaks."""
        case = ["--nodes=1", "--ntasks=2", sys.executable, *self.arguments("srun", DDP)]
        done = self.plain([*SRUN, *case])
        return _expect(done.returncode == 0 and done.stderr.count("Results in") == 1, done.stderr)

    def tasks_without_srun(self) -> str:
        """Two tasks of which srun starts none are refused with the cure."""
        job = self.submit("refused", ("model=haptic",), 2, ())
        until(lambda: not asked("squeue", "-h", "-j", job), PATIENCE)
        said = (self.folder / "refused.log").read_text()
        return _expect("put srun before the command" in said, said)

    def requeue(self) -> str:
        """A job that is requeued in its midst."""
        return self._interrupted("requeued", FUSION, _requeue)

    def requeue_by_signal(self) -> str:
        """A job that gets SIGUSR1, as by --signal=USR1@SECONDS, queues itself again."""
        return self._interrupted("usr1", FUSION, _signal)

    def requeue_of_ddp(self) -> str:
        """Two tasks that are requeued in their midst."""
        return self._interrupted("requeued_ddp", DDP, _requeue)

    def requeue_of_ddp_by_signal(self) -> str:
        """Two tasks that get SIGUSR1 queue their job once."""
        return self._interrupted("usr1_ddp", DDP, _signal)

    def _interrupted(
        self, case: str, given: tuple[str, ...], how: Callable[[str], object], *more: str
    ) -> str:
        """A batch job that is ended and begins again goes on to the same weights."""
        tasks = 1 if given == FUSION else 2
        whole = self.undisturbed("fusion", given) if given == FUSION else self._whole_ddp()
        job = self.submit(case, given, tasks, SRUN, *more)
        if not self.in_midst(self.folder / "runs" / case):
            return "did not begin"
        how(job)
        requeued = _again(job)
        until(lambda: not asked("squeue", "-h", "-j", job), PATIENCE)
        said = (self.folder / f"{case}.log").read_text()
        if not requeued:
            return f"was not requeued {_expect(False, said)}"
        return self.same(whole, case) or _expect("Going on with the run in" in said, said)

    def time_limit(self) -> str:
        """A job that takes longer than its limit queues itself again until it has ended."""
        given = ("model=haptic", "model.haptic.fit.epochs=300")
        whole = self.undisturbed("unlimited", given)
        job = self.submit("limit", given, 1, SRUN, "--time=1", "--signal=USR1@30")
        ends = time.monotonic() + PATIENCE
        while (state := asked("squeue", "-h", "-j", job, "-o", "%T")) and time.monotonic() < ends:
            if state == "PENDING":
                asked("scontrol", "update", f"JobId={job}", "StartTime=now")
            time.sleep(1)
        said = (self.folder / "limit.log").read_text()
        return self.same(whole, "limit") or _expect("Going on with the run in" in said, said)

    def cancel(self) -> str:
        """A cancelled job leaves no result, and what the same command completes."""
        job = self.submit("scancel", FUSION, 1, SRUN)
        path = self.folder / "runs" / "scancel"
        if not self.in_midst(path):
            return "did not begin"
        asked("scancel", job)
        until(lambda: not asked("squeue", "-h", "-j", job), PATIENCE)
        if (path / "results.json").exists():
            return "had finished already"
        again = self.submit("scancel", FUSION, 1, SRUN)
        until(lambda: not asked("squeue", "-h", "-j", again), PATIENCE)
        return self.same(self.undisturbed("fusion", FUSION), "scancel")

    def torchrun(self) -> str:
        """Two processes of torchrun train as two tasks of srun do."""
        said = self.plain([*TORCHRUN, *self.arguments("torchrun", DDP)])
        once = said.stderr.count("Results in") == 1
        wrong = _expect(said.returncode == 0 and once, said.stderr)
        srun = self.folder / "runs" / "srun"
        return wrong or (self.same(srun, "torchrun") if srun.is_dir() else "")

    def torchrun_killed(self) -> str:
        """Killed in their midst and started again, they go on to the same weights."""
        arguments, path = [*TORCHRUN, *self.arguments("killed", DDP)], self.folder / "runs/killed"
        process = subprocess.Popen(
            arguments, cwd=self.folder, env=environment(), start_new_session=True,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        )  # fmt: skip
        begun = self.in_midst(path)
        workers = _below(process.pid)
        for number in (process.pid, *workers):  # torchrun gives each a session of its own
            os.kill(number, signal.SIGKILL)
        process.wait()
        again = self.plain(arguments)
        wrong = self.same(self._whole_ddp(), "killed")
        return wrong or _expect(begun and "Going on" in again.stderr, again.stderr)

    def _whole_ddp(self) -> Path:
        """An undisturbed training in two processes."""
        path = self.folder / "runs" / "torchrun"
        if not (path / "results.json").is_file():
            self.plain([*TORCHRUN, *self.arguments("torchrun", DDP)])
        return path


CHECKS: tuple[Callable[[Bench], str], ...] = (
    Bench.ddp_of_srun, Bench.tasks_without_srun, Bench.torchrun, Bench.torchrun_killed,
    Bench.requeue, Bench.requeue_by_signal, Bench.requeue_of_ddp, Bench.requeue_of_ddp_by_signal,
    Bench.time_limit, Bench.cancel, Bench.sweep_of_folds, Bench.sweep_with_a_failure,
    Bench.sweep_with_a_requeued_job, Bench.sweep_with_a_cancelled_job, Bench.sweep_of_many_jobs,
)  # fmt: skip
OF_TORCHRUN = (Bench.torchrun, Bench.torchrun_killed)  # which need no SLURM


def measure(only: str = "", jobs: str = "50") -> dict[str, Any]:
    """Whether each check holds, and how long it takes.

    Raises:
        RuntimeError: If one does not.
    """
    return checked(Bench, CHECKS, only, int(jobs))


def checked(
    kind: type[Any], checks: Sequence[Callable[[Any], str]], only: str, jobs: int = 0,
    *, accounting: bool = False,
) -> dict[str, Any]:  # fmt: skip
    """Run the checks with a word in their name, each a method of a kind of :class:`Bench`.

    Raises:
        RuntimeError: If one does not hold.
    """
    chosen = [each for each in checks if only in each.__name__]
    figures: dict[str, Any] = {}
    wrong: dict[str, str] = {}
    with tempfile.TemporaryDirectory() as name:
        bench = kind(Path(name), jobs)
        bench.folder.chmod(0o755)  # munge asks for it
        drawn = ("task=generate", "data.classes=3", f"generate.out={bench.folder / 'surfaces'}")
        run(bench.folder, "generate", (*drawn, "debug=tiny", "data.synthetic.recordings=10"))
        alone = {*chosen} <= {*OF_TORCHRUN}
        slurm = nullcontext() if alone else cluster(bench.folder / "slurm", accounting=accounting)
        with slurm:
            for check in chosen:
                begin = time.perf_counter()
                said = _outcome(check, bench)
                seconds = time.perf_counter() - begin
                line = f"{check.__name__.replace('_', ' ')}: {'FAILED' if said else 'ok'}"
                print(f"{line}, {seconds:.0f} s {said}", flush=True)
                figures[check.__name__] = {"ok": not said, "seconds": seconds}
                wrong |= {check.__name__: said} if said else {}
    if wrong:
        raise RuntimeError(f"{len(wrong)} of {len(chosen)} checks failed: {', '.join(wrong)}")
    return figures


def _requeue(job: str) -> None:
    asked("scontrol", "requeue", job)


def _signal(job: str) -> None:
    asked("scancel", "--signal=USR1", job)


def _outcome(check: Callable[[Bench], str], bench: Bench) -> str:
    """What is wrong, also if the check itself ends."""
    try:
        return check(bench)
    except (OSError, LookupError, subprocess.SubprocessError) as error:
        return f"{type(error).__name__}: {error}"


def _again(job: str) -> bool:
    """Wait until a job is queued once more, and let it begin without the usual two minutes."""
    waits = until(lambda: "PENDING" in asked("squeue", "-h", "-j", job, "-o", "%T"), 60)
    asked("scontrol", "update", f"JobId={job}", "StartTime=now")
    return waits


def _first_of_array() -> str:
    """The first job of the sweep that runs."""
    return f"{asked('squeue', '-h', '-o', '%F').split()[0]}_0"


def _below(parent: int) -> list[int]:
    """The numbers of the processes that one has started."""
    children = Path(f"/proc/{parent}/task/{parent}/children").read_text(encoding="ascii")
    return [int(number) for number in children.split()]


def _rows(sweep: Path) -> list[dict[str, str]]:
    path = sweep / "sweep.csv"
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def _done(rows: list[dict[str, str]]) -> int:
    """How many jobs are done; lines that pool several have no number for a name."""
    return sum(row["status"] == "done" and row["job"].isdecimal() for row in rows)


def _expect(holds: bool, said: str) -> str:
    return "" if holds else json.dumps(said[-2000:])
