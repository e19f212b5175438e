"""Checkpoints of epochs: the last, to resume from, and the best, whose weights are taken."""

import logging
from pathlib import Path
from typing import Any, cast

import torch
from lightning.fabric.plugins import TorchCheckpointIO
from lightning.pytorch.callbacks import Checkpoint, ModelCheckpoint

from tex_lightning.classifier.contract_check import saved
from tex_lightning.core.files import write_atomically
from tex_lightning.core.run_folder import SUFFIX
from tex_lightning.errors import UserError
from tex_lightning.learning.module import SurfaceModule

BEST, LAST = "best", "last"  # epochs that are kept

log = logging.getLogger(__name__)


class Keeper(ModelCheckpoint):
    """Keeps the epoch with the smallest ``monitor``, or the last epoch.

    It has a class of its own, so that its state in a checkpoint is not that of a user's
    ModelCheckpoint.
    """

    def __init__(self, working: Path, name: str, monitor: str | None) -> None:
        super().__init__(
            dirpath=working,
            filename=name,
            monitor=monitor,
            save_on_train_epoch_end=True,  # a resumption then starts with a whole epoch
            enable_version_counter=False,
            auto_insert_metric_name=False,
        )


class CheckpointFiles(TorchCheckpointIO):
    """Checkpoints written straight to their file.

    Lightning writes them to memory first, which takes three times as long.
    """

    checked = False

    def save_checkpoint(
        self,
        checkpoint: dict[str, Any],
        path: str | Path,
        storage_options: Any | None = None,  # noqa: ANN401
    ) -> None:
        """Write the whole file, or leave the earlier one.

        Raises:
            UserError: If it cannot be written, or a callback's state not be read again.
        """
        for name, state in {} if self.checked else checkpoint.get("callbacks", {}).items():
            try:
                saved(state)
            except Exception as error:  # PyTorch and pickle have one for each kind of object
                raise UserError(
                    f"The state_dict of the callback {name} is not of plain values and tensors, "
                    "which alone are read from a checkpoint; convert what else it has."
                ) from error
        self.checked = True
        write_atomically(Path(path), lambda partial: torch.save(checkpoint, partial))


def find_resumable(working: Path) -> Path | None:
    """Return the checkpoint of the last finished epoch, to resume from; None if there is none.

    Raises:
        UserError: If it is damaged.
    """
    last = working / f"{LAST}{SUFFIX}"
    if not last.is_file():
        return None
    try:
        torch.load(last, map_location="cpu", weights_only=True)
    except Exception as error:  # damage shows in as many ways as there are formats
        raise UserError(
            f"Checkpoint {last} is damaged; delete {working} to train this network anew."
        ) from error
    return last


def take_best(module: SurfaceModule, keeper: Checkpoint | None) -> float | None:
    """Load the weights of the epoch with the best validation loss, and return that loss.

    Args:
        module: Trained module, on the CPU.
        keeper: The trainer's first ``checkpoint_callback``.

    Returns:
        The loss; None, with the weights unchanged, if nothing was validated.

    Raises:
        UserError: If the weights are NaN or infinite.
    """
    loss = None
    if isinstance(keeper, ModelCheckpoint) and keeper.monitor and keeper.best_model_path:
        # there is none of no epoch
        best = torch.load(keeper.best_model_path, map_location="cpu", weights_only=True)
        if not _is_finite(module):
            log.warning(
                "Training of the %s network diverged; its weights are those of epoch %d, the best "
                "one. Lower model.%s.fit.learning_rate.",
                module.kind, best["epoch"] + 1, module.kind,
            )  # fmt: skip
        module.load_state_dict(best["state_dict"])
        loss = float(cast(torch.Tensor, keeper.best_model_score))
    if not _is_finite(module):
        raise UserError(
            f"Training of the {module.kind} network diverged, its weights are NaN or infinite; "
            f"lower model.{module.kind}.fit.learning_rate."
        )
    module.float()  # whatever it was trained in
    return loss


def _is_finite(module: SurfaceModule) -> bool:
    return all(bool(value.isfinite().all()) for value in module.state_dict().values())
