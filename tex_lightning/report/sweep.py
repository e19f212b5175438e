"""The Hydra callback of a sweep: its lock, its failures, and its summary at the end."""

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, ClassVar

from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.core.console import NORMAL, Screen, say
from tex_lightning.core.run_folder import locked_folder
from tex_lightning.errors import UserError

ALL_COMBINATIONS = "hydra._internal.core_plugins.basic_sweeper.BasicSweeper"
ONE_BY_ONE = "hydra._internal.core_plugins.basic_launcher.BasicLauncher"
ON_SLURM = "hydra_plugins.hydra_submitit_launcher.submitit_launcher.SlurmLauncher"
NO_SWEEP = (
    "A sweep runs every job in one process; leave out trainer=ddp, trainer.devices and "
    "trainer.num_nodes, or run without -m."
)


@contextmanager
def _as_exit() -> Iterator[None]:
    """Convert a user's mistake to the command line's message."""
    try:
        yield
    except UserError as error:
        say(f"Error: {error}")
        raise SystemExit(2) from error


class SweepSummary(Callback):
    """Print and write ``sweep.csv`` in the sweep's folder when all jobs have run."""

    failures: ClassVar[int] = 0

    def __init__(self) -> None:
        self._running = ExitStack()

    def __reduce__(self) -> tuple[type["SweepSummary"], tuple[()]]:
        """Return the pickled form for the processes of a launcher, without the lock."""
        return SweepSummary, ()

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401
        """Reject settings that no job of a sweep can run with, before the first one.

        Raises:
            SystemExit: Hydra turns other exceptions of callbacks into warnings.
        """
        # its end reads checkpoints, and a launcher may run the jobs in other processes
        chosen: Any = OmegaConf.to_container(config)
        trust(*chosen["trusted"], *named_classes(chosen["model"]))
        trainer = OmegaConf.select(config, "trainer")
        with _as_exit():
            if (trainer.devices, trainer.num_nodes) != (1, 1):
                raise UserError(NO_SWEEP)
            self._running.enter_context(locked_folder(_folder(config), "hydra.sweep.dir"))
        verbose = OmegaConf.select(config, "verbose")
        Screen.verbose = verbose if isinstance(verbose, int) else NORMAL  # it may be swept
        if _launcher(config) == ON_SLURM:
            # else submitit prints its messages too, and on standard output once more
            os.environ.setdefault("SUBMITIT_LOG_LEVEL", "NOCONFIG")
            from tex_lightning.report.sweep_queue import follow_queue  # has an extra of its own

            follow_queue()

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:  # noqa: ANN401
        """Release a job's configuration, half a megabyte that Hydra would keep."""
        job_return.cfg = job_return.hydra_cfg = None

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401
        """Collect the results of the jobs.

        Raises:
            SystemExit: If it cannot be written.
        """
        with self._running, _as_exit():
            # takes PyTorch, which a wrong command ends without
            from tex_lightning.report.sweep_summary import summarise

            SweepSummary.failures = summarise(_folder(config), searched=is_search(config))


def _folder(config: DictConfig) -> Path:
    return Path(str(OmegaConf.select(config, "hydra.sweep.dir"))).resolve()


def is_search(config: DictConfig) -> bool:
    """Return whether a sweeper looks for the least objective, and does not try each combination."""
    target = OmegaConf.select(config, "hydra.sweeper._target_")
    return target is not None and str(target) != ALL_COMBINATIONS


def runs_side_by_side(config: DictConfig) -> bool:
    """Return whether a launcher runs the jobs of a sweep in processes of their own."""
    return _launcher(config) != ONE_BY_ONE


def _launcher(config: DictConfig) -> str:
    return str(OmegaConf.select(config, "hydra.launcher._target_"))
