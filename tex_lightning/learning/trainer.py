"""Lightning's Trainer as this package uses it: flags, callbacks, loggers, no advertisements."""

import logging
import signal
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import torch
from lightning import Callback, LightningModule, Trainer
from lightning.fabric.plugins import TorchCheckpointIO
from lightning.pytorch.callbacks import ModelCheckpoint, Timer
from lightning.pytorch.callbacks import ProgressBar as LightningProgressBar
from torch import nn

from tex_lightning.config import Config, TrainerConfig
from tex_lightning.config.instantiation import build, build_derived
from tex_lightning.config.model import FUSION
from tex_lightning.core.console import DEBUG, Screen
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import write_atomically
from tex_lightning.errors import UserError, reason
from tex_lightning.learning.base import make_optimizer
from tex_lightning.learning.callbacks import ProgressBar
from tex_lightning.learning.loggers import make_loggers, open_loggers

UNHELPFUL = (
    ".*does not have many workers.*",  # data is decoded already; workers rarely pay
    ".*exists and is not empty.*",  # that is what resuming means
    ".*in eval mode at the start of training.*",  # FusionModule keeps its statistics on purpose
    ".*configure_optimizers` returned `None`.*",  # of what is fitted in closed form
    ".*LeafSpec.*is deprecated.*",  # Lightning 2.6 with PyTorch 2.13, until Lightning follows
)
LOGGERS = ("lightning", "lightning.pytorch", "lightning.fabric")


class CheckpointFiles(TorchCheckpointIO):
    """Checkpoints written straight to their file.

    Lightning writes them to memory first, which takes three times as long.
    """

    def save_checkpoint(
        self,
        checkpoint: dict[str, Any],
        path: str | Path,
        storage_options: Any | None = None,  # noqa: ANN401
    ) -> None:
        """Write the whole file, or leave the earlier one.

        Raises:
            UserError: If it cannot be written.
        """
        write_atomically(Path(path), lambda partial: torch.save(checkpoint, partial))


class PlainTermination(Callback):
    """Let SIGTERM end one process of several at once.

    Lightning's handler talks to the other processes from within the signal, wherever they are, and
    all of them hang. The last finished epoch is kept in any case.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Undo what Lightning has registered just before."""
        if trainer.world_size > 1:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextmanager
def quiet_lightning() -> Iterator[None]:
    """Hide Lightning's advice and advertisements, except for debugging."""
    debugs = Screen.verbose >= DEBUG
    loggers = [logging.getLogger(name) for name in LOGGERS]
    before = [(each.level, each.handlers) for each in loggers]
    for each in loggers:
        each.setLevel(logging.INFO if debugs else logging.WARNING)
        each.handlers = []  # its own would say everything twice
    with warnings.catch_warnings():
        for message in () if debugs else UNHELPFUL:
            warnings.filterwarnings("ignore", message=message)
        try:
            yield
        finally:
            for each, (level, handlers) in zip(loggers, before, strict=True):
                each.setLevel(level)
                each.handlers = handlers


def make_trainer(
    config: Config, kind: str, directory: Path, validated: bool, watchers: Sequence[Callback]
) -> tuple[Trainer, Timer, ModelCheckpoint | None]:
    """Make the trainer, with its clock and, where it validates, the keeper of the best weights.

    Args:
        config: How the networks of the model are trained.
        kind: Name of the network.
        directory: The run folder.
        validated: Whether there are samples to validate on.
        watchers: Callbacks beside the configured ones.

    Raises:
        UserError: If a flag, a callback or a logger cannot be used.
    """
    fit, working = config.model.fit_values(kind), directory / "checkpoints" / kind
    timer, keeper = Timer(), _keep(working, "best", "val/loss") if validated else None
    # not Lightning's save_last, which leaves out the epochs that are not the best
    callbacks = [timer, keeper, _keep(working, "last", None), PlainTermination(), *watchers]
    callbacks += _configured_callbacks(config)
    flags = {
        "log_every_n_steps": min(10, fit["steps_per_epoch"]),
        "limit_val_batches": 1.0 if validated else 0,
        "num_sanity_val_steps": 0,
        "enable_model_summary": False,
        "sync_batchnorm": _synchronises(config.trainer, kind),
        **config.trainer.flags,
    }
    trainer = _lightning_trainer(
        flags,
        plugins=[CheckpointFiles()],
        max_epochs=fit["epochs"],
        callbacks=_with_progress_bar([each for each in callbacks if each is not None], flags),
        logger=open_loggers(config.logger, directory, kind),
        use_distributed_sampler=False,  # every process knows its share of a batch
        default_root_dir=directory,
    )
    return trainer, timer, keeper


def try_parts_of_training(config: Config, directory: Path) -> None:
    """Make what the trainings of a model will make, so that wrong arguments are refused before.

    Args:
        config: How the networks are trained.
        directory: The run folder.

    Raises:
        UserError: Naming the key of what cannot be made.
    """
    model = config.model
    make_loggers(config.logger, directory, model.kind)
    if model.baseline is not None:
        return
    callbacks = _configured_callbacks(config)
    if any(model.fit_values(kind)["epochs"] for kind in model.trained):
        with quiet_lightning():
            _lightning_trainer(config.trainer.flags, callbacks=[ModelCheckpoint(), *callbacks])
    for kind in model.trained:
        fit = model.fit_values(kind)
        if fit["epochs"]:
            weights = [nn.Parameter(torch.zeros(2, 2)) for _ in range(2)]
            make_optimizer(f"model.{kind}.fit", fit, weights[:1], weights[1:])


def _configured_callbacks(config: Config) -> list[Callback]:
    return [
        build_derived(f"callbacks.{name}", node, Callback)
        for name, node in config.callbacks.items()
    ]


def _lightning_trainer(flags: dict[str, Any], **own: Any) -> Trainer:  # noqa: ANN401
    if isinstance(flags["strategy"], dict):
        flags = {**flags, "strategy": build("trainer.strategy", flags["strategy"])}
    try:
        return Trainer(**flags, **own)
    except Exception as error:  # Lightning checks some of its flags, and others by using them
        raise UserError(
            f"Lightning's Trainer refuses what trainer says: {reason(error)}; correct that flag."
        ) from error


def _with_progress_bar(callbacks: list[Callback], flags: dict[str, Any]) -> list[Callback]:
    """Add this package's bar, unless the user has named another one or wants none."""
    bars = [each for each in callbacks if isinstance(each, LightningProgressBar)]
    if not flags.get("enable_progress_bar", True):
        return [each for each in callbacks if each not in bars]
    return callbacks if bars else [*callbacks, ProgressBar()]


def _synchronises(trainer: TrainerConfig, kind: str) -> bool:
    """Whether batch normalisation is over whole batches: on GPUs, but for FusionNet's, fixed."""
    several = trainer.devices != 1 or trainer.num_nodes != 1
    return several and kind != FUSION and pick_device(trainer.accelerator).type == "cuda"


def _keep(working: Path, name: str, monitor: str | None) -> ModelCheckpoint:
    """Keep the epoch with the least ``monitor``, or the last one."""
    return ModelCheckpoint(
        dirpath=working,
        filename=name,
        monitor=monitor,
        save_on_train_epoch_end=True,  # a resumption then starts with a whole epoch
        enable_version_counter=False,
        auto_insert_metric_name=False,
    )
