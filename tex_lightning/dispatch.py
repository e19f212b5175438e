"""Run the task that a composed configuration names."""

import os
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module

import torch
from omegaconf import DictConfig

from tex_lightning.config import SILENT, Config, flatten, plain_values
from tex_lightning.config.check import AUTO, check_config, check_known, check_missing, check_shares
from tex_lightning.config.job import Job
from tex_lightning.config.trust import named_classes, trust
from tex_lightning.config.weights import read_config
from tex_lightning.core.console import Screen, verbosity
from tex_lightning.core.devices import check_precision, count_processes, kept_memory, use_tf32
from tex_lightning.core.files import quiet_threads
from tex_lightning.core.progress import finishing
from tex_lightning.core.ranks import is_rank_zero, started_processes
from tex_lightning.core.run_folder import claim_folder, find_checkpoint, locked_folder
from tex_lightning.defaults import TRAINING, with_defaults
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import optimized_value
from tex_lightning.report.sweep import NO_SWEEP, runs_side_by_side


def run_task(composed: DictConfig, job: Job) -> float | None:
    """Check the configuration and run its task in the run folder of the job.

    Every process of a training on several devices does; only rank zero writes.

    Returns:
        What a sweeper that searches is to minimise; None of a task that trains nothing.

    Raises:
        UserError: If the configuration or what it names cannot be used.
    """
    Screen.sweep = job.origin == "sweep"
    several = Screen.sweep and runs_side_by_side(job.hydra)
    Screen.job = f"Job {job.hydra.hydra.job.num}: " if several else ""
    config, composed, job = settled_config(composed, job)
    if config.checkpoint is not None:
        config = replace(config, checkpoint=str(find_checkpoint(config.checkpoint)))
    set_threads(config.task, config.trainer.threads)
    use_tf32(config.trainer.tf32)
    processes = 1
    if config.task in TRAINING:
        check_precision(config.trainer)
        processes = count_processes(config.trainer)
    if processes > 1:
        _check_origin(job)
    check_shares(config, processes)
    if started_processes() and not job.named:
        raise UserError(
            "Several processes were started, which have to share a run folder; give hydra.run.dir."
        )
    trust(*config.trusted, *named_classes(config.model.nodes))
    own = is_rank_zero() and config.task not in SILENT
    with (
        verbosity(config.verbose),
        finishing(),
        kept_memory(),
        quiet_threads(),
        locked_folder(job.directory) if own else nullcontext(),
    ):
        if is_rank_zero():
            claim_folder(composed, flatten(plain_values(config)), job)
        if config.model.name == AUTO:
            from tex_lightning.auto import resolve_auto  # Lightning, which predictions do without

            config = resolve_auto(config.frontier.run, config.data.test_fold, job)
        # a task is imported when it runs: most take Lightning, which predictions do without
        results = import_module(f"tex_lightning.tasks.{config.task}").run(config, job)
        if results and config.task not in SILENT:  # other ranks have none
            from tex_lightning.report.page import write_page

            write_page(job.directory)
    if config.task in TRAINING and results:
        return optimized_value(results, config.optimized_metric)
    return None


def settled_config(composed: DictConfig, job: Job) -> tuple[Config, DictConfig, Job]:
    """Check a configuration, and fill in what its own recordings decide.

    Returns:
        It, typed and as composed, and the job that asks for all of it.

    Raises:
        UserError: If a value cannot be used.
    """
    check_known(composed)
    check_missing(composed)
    config = read_config(composed)
    check_config(config)
    if (settled := with_defaults(config.task, config.data, config.model, job)) is not job:
        job, composed = settled, settled.compose(settled.overrides)
        config = read_config(composed)
        check_config(config)
    return config, composed, job


def _check_origin(job: Job) -> None:
    """Refuse several processes where Lightning cannot start them by the same command line."""
    if job.origin == "sweep":
        raise UserError(NO_SWEEP)
    if job.origin == "python" and not started_processes():
        raise UserError(
            "Python trains in this process alone; for several devices run python -m tex_lightning, "
            "or start this program with torchrun."
        )


def set_threads(task: str, threads: int | None) -> None:
    """Set PyTorch's threads on the CPU: as configured, else one for a live stream.

    The layers of a short chunk are so small that a second thread only costs time.
    A user's ``OMP_NUM_THREADS`` is left as it is.
    """
    if threads is None and task in ("stream", "record") and "OMP_NUM_THREADS" not in os.environ:
        threads = 1
    if threads is not None:
        torch.set_num_threads(threads)
