"""From a composed configuration to the task it names."""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from tex_lightning.auto import resolve_auto
from tex_lightning.config import Config
from tex_lightning.config.check import AUTO, check_config, check_known, check_missing, check_shares
from tex_lightning.config.weights import read_config
from tex_lightning.devices import count_processes
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import optimized_value
from tex_lightning.memory import kept_memory
from tex_lightning.ranks import is_rank_zero, started_processes
from tex_lightning.report.opening import announced_once
from tex_lightning.report.sweep import NO_SWEEP
from tex_lightning.runfolder import claim_folder, find_checkpoint
from tex_lightning.tasks import (
    crossval,
    evaluate,
    fit,
    frontier,
    generate,
    predict,
    pretrain,
    profile,
    stability,
    stream,
)

TASKS: dict[str, Callable[[Config, Path], Any]] = {
    "fit": fit.run,
    "crossval": crossval.run,
    "evaluate": evaluate.run,
    "predict": predict.run,
    "stream": stream.run,
    "generate": generate.run,
    "pretrain": pretrain.run,
    "profile": profile.run,
    "frontier": frontier.run,
    "stability": stability.run,
}

TRAINING = ("fit", "crossval")  # on several devices


def run_task(composed: DictConfig, directory: Path) -> float | None:
    """Check the configuration and run its task with ``directory`` as the run folder.

    Every process of a training on several devices does; only rank zero writes.

    Returns:
        What a sweeper that searches is to minimise; None of a task that trains nothing.

    Raises:
        UserError: If the configuration or what it names cannot be used.
    """
    check_known(composed)
    check_missing(composed)
    config = read_config(composed)
    check_config(config)
    if config.checkpoint is not None:
        config = replace(config, checkpoint=str(find_checkpoint(config.checkpoint)))
    set_threads(config)
    processes = count_processes(config.trainer) if config.task in TRAINING else 1
    if processes > 1 and HydraConfig.get().mode == RunMode.MULTIRUN:
        raise UserError(NO_SWEEP)
    check_shares(config, processes)
    if started_processes() and not _names_folder():
        raise UserError(
            "Several processes were started, which have to share a run folder; give hydra.run.dir."
        )
    with kept_memory(), announced_once(config):
        if is_rank_zero():
            claim_folder(composed, config, directory.resolve())
        if config.model.name == AUTO:
            config = resolve_auto(config, directory.resolve())
        results = TASKS[config.task](config, directory.resolve())
    if config.task in TRAINING and results:  # other ranks have none
        return optimized_value(results, config.optimized_metric)
    return None


def _names_folder() -> bool:
    return any(each.startswith("hydra.run.dir=") for each in HydraConfig.get().overrides.hydra)


def set_threads(config: Config) -> None:
    """Set PyTorch's threads on the CPU: as configured, else one for a live stream.

    The layers of a short chunk are so small that a second thread only costs time
    (``python -m benchmarks threads``). A user's ``OMP_NUM_THREADS`` is left as it is.
    """
    threads = config.trainer.threads
    if threads is None and config.task == "stream" and "OMP_NUM_THREADS" not in os.environ:
        threads = 1
    if threads is not None:
        torch.set_num_threads(threads)
