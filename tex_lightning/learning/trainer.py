"""Make Lightning's Trainer, and let it take the steps of a training."""

import inspect
import logging
import re
import signal
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, ClassVar

import torch
from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import LambdaCallback
from lightning.pytorch.callbacks import ProgressBar as LightningProgressBar
from lightning.pytorch.loggers import Logger
from lightning.pytorch.trainer.states import TrainerStatus

from tex_lightning.config import TrainerConfig
from tex_lightning.config.instantiation import build, build_derived
from tex_lightning.config.nodes import is_node
from tex_lightning.core.console import DEBUG, Screen, log_once
from tex_lightning.core.contract import check_call
from tex_lightning.core.progress import Stage, hidden
from tex_lightning.data.datamodule import SurfaceData
from tex_lightning.errors import UserError, nearest, reason
from tex_lightning.learning.epoch_checkpoints import BEST, LAST, CheckpointFiles, Keeper
from tex_lightning.learning.module import REFRESH, SurfaceModule

UNHELPFUL = (
    ".*does not have many workers.*",  # data is decoded already; workers rarely pay
    ".*exists and is not empty.*",  # that is what resuming means
    ".*in eval mode at the start of training.*",  # a FusionNet keeps its statistics
    ".*configure_optimizers` returned `None`.*",  # of what is fitted in closed form
    ".*`srun` command is available.*",  # it may be installed and not be meant
    ".*LeafSpec.*is deprecated.*",  # Lightning 2.6 with PyTorch 2.13, until Lightning follows
)
UNKNOWN_FLAG = re.compile(r"unexpected keyword argument '(\w+)'")
ONE_VALUE = "Expected more than 1 value per channel"  # PyTorch's words of batch normalisation
INSTEAD = {  # of flags that are not the user's
    "callbacks": "add yours by callbacks=[default,NAME]",
    "logger": "choose by logger=NAME, or logger=[] for none",
    "default_root_dir": "choose the folder by hydra.run.dir=DIR",
    "use_distributed_sampler": "leave it out",
}
NEVER_CALLED = ("_", "on_test", "on_predict")  # by a training, of the methods of callbacks
LOGGERS = ("lightning", "lightning.pytorch", "lightning.fabric")

log = logging.getLogger(__name__)


class ProgressBar(LightningProgressBar):
    """Bar of epochs, loss and accuracy."""

    shown: ClassVar = {
        "train/loss": "loss {:.3g}".format,
        "val/loss": "val {:.3g}".format,
        "val/vote_accuracy": "accuracy {:.0%}".format,
    }

    def __init__(self) -> None:
        super().__init__()
        self.epochs: Stage | None = None

    def disable(self) -> None:
        """Do nothing: :class:`Screen` decides which process shows the bar."""

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Start the count after the epochs of an earlier run."""
        self.epochs = Stage("epoch", trainer.max_epochs, trainer.current_epoch)

    def on_train_batch_end(
        self,
        trainer: Trainer,
        pl_module: LightningModule,
        outputs: object,
        batch: object,
        batch_idx: int,
    ) -> None:
        """Count a step."""
        last = batch_idx + 1 >= trainer.num_training_batches
        if self.epochs is not None and not last and (batch_idx + 1) % REFRESH == 0:
            part = (batch_idx + 1) / trainer.num_training_batches
            self.epochs.update(trainer.current_epoch + part, notes=self._notes(trainer))

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Count an epoch."""
        notes = self._notes(trainer)
        log.debug("Epoch %d: %s.", trainer.current_epoch + 1, ", ".join(notes))
        if self.epochs is not None:
            self.epochs.update(trainer.current_epoch + 1, notes=notes)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Count no more."""
        if self.epochs is not None:
            self.epochs.end()

    def on_exception(
        self, trainer: Trainer, pl_module: LightningModule, exception: BaseException
    ) -> None:
        """Count no more."""
        self.on_train_end(trainer, pl_module)

    def _notes(self, trainer: Trainer) -> list[str]:
        metrics = trainer.callback_metrics
        return [text(float(metrics[name])) for name, text in self.shown.items() if name in metrics]


@contextmanager
def quiet_lightning() -> Iterator[None]:
    """Hide Lightning's advice and advertisements, except for debugging."""
    debugs = Screen.verbose >= DEBUG
    loggers = [logging.getLogger(name) for name in LOGGERS]
    before = [(logger.level, logger.handlers) for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.INFO if debugs else logging.WARNING)
        logger.handlers = []  # its own would say everything twice
    with warnings.catch_warnings():
        for message in () if debugs else UNHELPFUL:
            warnings.filterwarnings("ignore", message=message)
        try:
            yield
        finally:
            for logger, (level, handlers) in zip(loggers, before, strict=True):
                logger.setLevel(level)
                logger.handlers = handlers


def make_trainer(
    settings: TrainerConfig,
    callbacks: Sequence[Callback],
    loggers: Sequence[Logger],
    fit: Mapping[str, Any],
    working: Path,
    *,
    validated: bool,
) -> Trainer:
    """Make the trainer, with callbacks that keep the checkpoints of the last and the best epoch.

    The best epoch is kept only where samples are ``validated``; its callback is then the trainer's
    first ``checkpoint_callback``. Flags of the settings override those of this package. Epochs are
    kept in the folder ``working``, ``RUN/checkpoints/NETWORK``.

    Raises:
        UserError: If a flag cannot be used.
    """
    # not Lightning's save_last, which skips epochs that are not the best; the callback of the best
    # epoch comes first, since the last checkpoint contains its state
    best = [Keeper(working, BEST, "val/loss")] if validated else []
    keepers = [*best, Keeper(working, LAST, None)]
    flags = _flags(settings, fit, working.name, validated=validated)
    more = flags.pop("plugins", [])
    try:
        return Trainer(
            **flags,
            plugins=[CheckpointFiles(), *(more if isinstance(more, list) else [more])],
            callbacks=[*keepers, *callbacks],
            logger=[*loggers],
            use_distributed_sampler=False,  # every process knows its share of a batch
            default_root_dir=working.parents[1],
        )
    except Exception as error:  # Lightning checks some of its flags, and others by using them
        unknown = UNKNOWN_FLAG.search(str(error))
        name = unknown[1] if unknown else ""
        ours = f", or give model.{working.name}.fit.{name}" if name in fit else ""
        near = nearest(name, inspect.signature(Trainer).parameters, "trainer.") if name else ""
        raise UserError(
            f"Lightning's Trainer rejects a flag of trainer: {reason(error)}{near}; correct that "
            f"flag{ours}."
        ) from error


def _flags(
    settings: TrainerConfig, fit: Mapping[str, Any], network: str, *, validated: bool
) -> dict[str, Any]:
    """Return the flags of the trainer, and build the objects that they name."""
    flags = {
        "log_every_n_steps": min(10, fit["steps_per_epoch"]),
        "limit_val_batches": 1.0 if validated else 0,
        "num_sanity_val_steps": 0,
        "enable_model_summary": False,
        "sync_batchnorm": settings.accelerator != "cpu" and torch.cuda.is_available(),
        "max_epochs": fit["epochs"],
        **settings.flags,
    }
    epochs = f"model.{network}.fit.epochs"
    if "max_epochs" in settings.flags and fit["epochs"]:
        log_once(log, f"trainer.max_epochs is of every network of this run, {epochs} of one.")
    if not fit["epochs"]:  # what is fitted in closed form takes no step
        flags["max_epochs"] = 0
    if type(flags["max_epochs"]) is not int:  # which Lightning would find in the midst of work
        raise UserError(
            f"trainer.max_epochs={flags['max_epochs']} is no number; correct it, or give {epochs}."
        )
    if taken := next((name for name in INSTEAD if name in flags), None):
        raise UserError(f"trainer.{taken} is set by this package; {INSTEAD[taken]}.")
    return {name: _built(f"trainer.{name}", value) for name, value in flags.items()}


def _built(where: str, value: Any) -> Any:  # noqa: ANN401
    """Return a flag, with the objects that it or its items name by ``_target_``."""
    if isinstance(value, list):
        return [_built(f"{where}.{index}", item) for index, item in enumerate(value)]
    return build(where, value) if is_node(value) else value


def build_callbacks(nodes: Mapping[str, Any], flags: Mapping[str, Any]) -> list[Callback]:
    """Build the configured callbacks; without progress bars where flags leave them out.

    Raises:
        UserError: If one cannot be made.
    """
    callbacks = [build_derived(f"callbacks.{name}", node, Callback) for name, node in nodes.items()]
    for key, callback in zip(nodes, callbacks, strict=True):
        _check_hooks(f"callbacks.{key}", callback)
    if flags.get("enable_progress_bar", True):
        return callbacks
    return [callback for callback in callbacks if not isinstance(callback, LightningProgressBar)]


def _check_hooks(where: str, callback: Callback) -> None:
    """Reject a callback with a method that cannot be called as a training does.

    Lightning gives ``stage`` by its name, leaves out ``dataloader_idx``, the only argument with a
    default, and calls no method that is None.
    """
    for name, hook in vars(Callback).items():
        own: Any = getattr(callback, name)
        if not (inspect.isfunction(hook) and callable(own)) or name.startswith(NEVER_CALLED):
            continue
        arguments = [*inspect.signature(hook).parameters.values()][1:]
        given = [each.name for each in arguments if each.default is each.empty]
        in_turn = (each for each in given if each != "stage")
        part = where, "callback", callback
        check_call(part, own, *in_turn, by_name=[each for each in given if each == "stage"])


def fit_network(
    trainer: Trainer, module: SurfaceModule, data: SurfaceData, resumed: Path | None
) -> None:
    """Take the training steps, from the start or from a checkpoint.

    Raises:
        UserError: If batches are too small for batch normalisation.
        KeyboardInterrupt: If the user stopped it.
    """
    bar, handler = trainer.progress_bar_callback, signal.getsignal(signal.SIGINT)
    try:
        with ExitStack() as stack:
            if bar is not None and not isinstance(bar, ProgressBar):  # before it draws
                hide = LambdaCallback(on_train_start=lambda *_: stack.enter_context(hidden()))
                trainer.callbacks.insert(0, hide)  # type: ignore[attr-defined]  # by a connector
            # The folder holds only this package's own checkpoints of plain values and tensors.
            trainer.fit(module, datamodule=data, ckpt_path=resumed, weights_only=True)
    except ValueError as error:
        if ONE_VALUE not in str(error):
            raise
        raise UserError(
            "Batch normalisation takes more than one position of a batch; raise "
            f"model.{module.kind}.fit.batch_size, or set norm=none of what is trained."
        ) from error
    except SystemExit as stop:  # Lightning's answer to Ctrl-C, which it ignores from then on
        if stop.code not in (1, None):  # submitit's, which has queued the job again
            raise
        if threading.current_thread() is threading.main_thread():
            signal.signal(signal.SIGINT, handler)  # a notebook goes on
        raise KeyboardInterrupt from stop
    if trainer.state.status == TrainerStatus.INTERRUPTED:
        raise KeyboardInterrupt
