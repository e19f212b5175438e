"""Follow the jobs of a sweep in SLURM's queue, and note those that SLURM ended as failed.

submitit asks SLURM's accounting. Without accounting it warns at every question and waits forever
for a cancelled job; with it, a cancelled job ends the sweep before its summary is written.
"""

import re
from pathlib import Path
from typing import Any

from hydra.core.utils import JobReturn, JobStatus
from omegaconf import open_dict
from submitit.core.utils import FailedJobError, UncompletedJobError
from submitit.slurm import slurm
from submitit.slurm.slurm import SlurmExecutor, SlurmInfoWatcher, SlurmJob

from tex_lightning.core.run_folder import note_failure

ASK = ("squeue", "--me", "--array", "--noheader", "--states=all", "--format=%F_%K %T")
OVER = ("BOOT_FAIL", "CANCELLED", "COMPLETED", "DEADLINE", "FAILED", "NODE_FAIL", "OUT_OF_MEMORY",
        "TIMEOUT")  # fmt: skip
GONE = "no longer in the queue"  # where SLURM lists a job for a few minutes after its end
PATIENCE = 60  # seconds between two questions, at most


class QueueWatcher(SlurmInfoWatcher):
    """The states of jobs, as ``squeue`` lists them."""

    def _make_command(self) -> list[str] | None:
        return [*ASK] if self._registered - self._finished else None

    def read_info(self, string: bytes | str) -> dict[str, dict[str, str]]:
        """Return the state of every job by its number; waiting and running are one.

        Args:
            string: A line such as ``12_3 RUNNING`` for each; ``12_N/A`` is no job of an array.
        """
        text = string if isinstance(string, str) else string.decode()
        listed = dict(re.findall(r"^(\d+(?:_\d+)?)(?:_N/A)? (\w+)$", text, re.MULTILINE))
        states = {job: listed.get(job, GONE) for job in self._registered}
        waits = {state for state in states.values() if state not in (*OVER, GONE)}
        return {job: {"State": "RUNNING" if x in waits else x} for job, x in states.items()}


class QueueJob(SlurmJob[Any]):
    """A job that leaves its failure in its folder, also if SLURM has ended it."""

    watcher = QueueWatcher(PATIENCE)

    def results(self) -> list[Any]:
        """Wait for the job; one that was lost has no result, and its reason is written."""
        try:
            return super().results()
        except (UncompletedJobError, FailedJobError) as error:
            ended = f"SLURM ended this job ({self.state})"
            failed = isinstance(error, FailedJobError)
            said = "This job could not run" if failed else ended
            directory, overrides = self._folder()
            note_failure(directory, overrides, f"{said}; its messages are in {self.paths.stderr}.")
            return [JobReturn(status=JobStatus.COMPLETED)]

    def _folder(self) -> tuple[Path, list[str]]:
        """Return the folder and overrides that Hydra makes of what was submitted."""
        submitted = self.submission()
        launcher: Any = submitted.function
        overrides, _, number, *_ = submitted.args
        config = launcher.hydra_context.config_loader.load_sweep_config(launcher.config, overrides)
        with open_dict(config):
            config.hydra.job.num = number
        sweep = config.hydra.sweep
        return Path(sweep.dir).resolve() / str(sweep.subdir), [*config.hydra.overrides.task]


def follow_queue() -> None:
    """Let submitit ask the queue for the jobs of this process."""
    SlurmExecutor.job_class = QueueJob
    slurm.SlurmJob = QueueJob  # type: ignore[misc]  # which it makes of an array
