"""Lightning's Trainer as this package uses it: callbacks, loggers, and no advertisements."""

import logging
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ClassVar

import torch
import torch.distributed as dist
from lightning import Callback, LightningModule, Trainer
from lightning.fabric.plugins import TorchCheckpointIO
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from lightning.pytorch.callbacks import ModelCheckpoint, RichProgressBar, Timer
from lightning.pytorch.loggers import CSVLogger, Logger, TensorBoardLogger
from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn

from tex_lightning.data.folds import make_samples
from tex_lightning.distributed.place import Place
from tex_lightning.distributed.team import Team
from tex_lightning.files import write_atomically
from tex_lightning.learning.base import REFRESH
from tex_lightning.learning.callbacks.figures import SampleFigures
from tex_lightning.learning.callbacks.fusion import FusionStart
from tex_lightning.learning.training import Training

UNHELPFUL = (
    ".*does not have many workers.*",  # data is decoded already; workers rarely pay
    ".*exists and is not empty.*",  # that is what resuming means
    ".*in eval mode at the start of training.*",  # FusionModule keeps its statistics on purpose
    ".*LeafSpec.*is deprecated.*",  # Lightning 2.6 with PyTorch 2.13, until Lightning follows
)


class StartedAlready(LightningEnvironment):
    """What Lightning asks of processes that were started and connected without it."""

    def __init__(self, place: Place, nodes: int) -> None:
        super().__init__()
        self.place, self.nodes = place, nodes

    @property
    def creates_processes_externally(self) -> bool:
        """So that Lightning does not run the command line once more."""
        return True

    def local_rank(self) -> int:
        """Number of this process on its node."""
        return self.place.local

    def node_rank(self) -> int:
        """Number of this process's node."""
        return self.place.rank // (self.place.size // self.nodes)

    def teardown(self) -> None:
        """Leave the environment to those who made it."""


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
    """Let SIGTERM end a process at once.

    Lightning's handler talks to the other processes from within the signal, wherever they are, and
    all of them hang. The last finished epoch is kept in any case.
    """

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Undo what Lightning has registered just before."""
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


class ProgressBar(RichProgressBar):
    """Lightning's bar for 80 columns: epochs are counted from 1, the metrics are the main ones."""

    shown: ClassVar = {"train/loss": "loss", "val/loss": "val_loss", "val/vote_accuracy": "votes"}

    def get_metrics(self, *args: Any) -> dict[str, int | str | float | dict[str, float]]:  # noqa: ANN401
        """The metrics beside the bar."""
        metrics = super().get_metrics(*args)
        return {short: metrics[name] for name, short in self.shown.items() if name in metrics}

    def configure_columns(self, trainer: Trainer) -> list[Any]:
        """Epoch, bar, steps and time left; Lightning adds the metrics."""
        return [
            TextColumn("[progress.description]{task.description}"),
            BarColumn(bar_width=8),
            MofNCompleteColumn(),
            TimeRemainingColumn(compact=True),
        ]

    def _get_train_description(self, current_epoch: int) -> str:
        text = f"Epoch {current_epoch + 1}/{self.trainer.max_epochs}"
        return f"{text:<{len(self.validation_description)}}"  # so that the bars stay in line


@contextmanager
def quiet_lightning() -> Iterator[None]:
    """Keep Lightning's advice and advertisements out of the user's way."""
    logger = logging.getLogger("lightning.pytorch")
    level, handlers = logger.level, logger.handlers
    logger.setLevel(logging.WARNING)
    logger.handlers = []  # its own handler would say everything twice
    with warnings.catch_warnings():
        for message in UNHELPFUL:
            warnings.filterwarnings("ignore", message=message)
        try:
            yield
        finally:
            logger.setLevel(level)
            logger.handlers = handlers


def make_trainer(
    training: Training, *watchers: Callback, resumed: bool
) -> tuple[Trainer, Timer, ModelCheckpoint | None]:
    """Make the trainer, with its clock and, where it validates, the keeper of the best weights.

    Args:
        training: What is trained.
        watchers: Callbacks beside those below.
        resumed: Whether it goes on from a checkpoint, and then logs beside the earlier metrics.
    """
    config, fit = training.config, training.fit_values
    validated = bool(make_samples(training.parts.val, training.card.kind))
    timer = Timer()
    keeper = _keep(training, "best", "val/loss") if validated else None
    # not Lightning's save_last, which leaves out the epochs that are not the best
    keepers = [keeper for keeper in (keeper, _keep(training, "last", None)) if keeper is not None]
    bar = ProgressBar(refresh_rate=REFRESH, console_kwargs={"stderr": True})
    callbacks: list[Callback] = [timer, *keepers, bar, SampleFigures(), *watchers]
    if training.card.kind == "fusion":
        paths = training.unimodal
        start = config.model.fusion.head_start
        callbacks.append(FusionStart(paths["haptic"], paths["visual"], fit["head_factor"], start))
    if Team.current is not None:
        callbacks.append(PlainTermination())
    trainer = Trainer(
        accelerator=config.trainer.accelerator,
        **_processes(training),
        plugins=_plugins(training),
        precision=config.trainer.precision,  # type: ignore[arg-type]  # a string from the config
        max_epochs=fit["epochs"],
        callbacks=callbacks,
        logger=_make_loggers(training, resumed=resumed),
        log_every_n_steps=min(10, fit["steps_per_epoch"]),
        limit_val_batches=1.0 if validated else 0,
        num_sanity_val_steps=0,
        enable_model_summary=False,
        default_root_dir=training.directory,
    )
    return trainer, timer, keeper


def _keep(training: Training, name: str, monitor: str | None) -> ModelCheckpoint:
    """Keep the epoch with the least ``monitor``, or the last one."""
    return ModelCheckpoint(
        dirpath=training.working,
        filename=name,
        monitor=monitor,
        save_on_train_epoch_end=True,  # a resumption then starts with a whole epoch
        enable_version_counter=False,
        auto_insert_metric_name=False,
    )


def _processes(training: Training) -> dict[str, Any]:
    """The trainer's arguments for as many processes as there are."""
    team = Team.current
    if team is None:
        return {"devices": 1}
    nodes = training.config.trainer.num_nodes
    return {
        "devices": team.place.size // nodes,
        "num_nodes": nodes,
        "strategy": "ddp",
        "use_distributed_sampler": False,  # every process knows its share of a batch
        # statistics of whole batches; there is no such layer for CPUs, and FusionNet's are fixed
        "sync_batchnorm": dist.get_backend() == "nccl" and training.card.kind != "fusion",
    }


def _plugins(training: Training) -> list[Any]:
    """How checkpoints are written and where this process stands among others."""
    team = Team.current
    place = [] if team is None else [StartedAlready(team.place, training.config.trainer.num_nodes)]
    return [CheckpointFiles(), *place]


def _make_loggers(training: Training, *, resumed: bool) -> list[Logger]:
    """CSV of metrics always, TensorBoard events if configured; a resumed run gets its own CSV."""
    kind: str = training.card.kind
    version = kind
    if resumed:
        earlier = len(list((training.directory / "metrics").glob(f"{kind}*")))
        version = f"{kind}_resumed{earlier}"
    loggers: list[Logger] = [CSVLogger(training.directory, name="metrics", version=version)]
    if training.config.logger.tensorboard:
        loggers.append(
            TensorBoardLogger(
                training.directory, name="tensorboard", version=kind, default_hp_metric=False
            )
        )
    return loggers
