"""Start FusionNet from trained unimodal networks, with a faster head (paper, section III-B)."""

import logging
from collections.abc import Mapping

from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config.model import MAX_FACTOR, MIN_FACTOR
from tex_lightning.errors import UserError
from tex_lightning.learning.fusion import FusionModule
from tex_lightning.networks.fusionnet import FusionNet

log = logging.getLogger(__name__)


class FusionStart(Callback):
    """Copy the unimodal networks and set the learning rate of the fusion layer.

    Args:
        starts: By sense the classifier whose network is copied.
        head_factor: Learning rate of the fusion layer over that of the networks, 10 to 50.
        head_start: ``scores`` begins with the sum of all networks' class scores, ``random`` with
            small random weights.

    Raises:
        UserError: If the factor is outside the paper's range.
    """

    def __init__(
        self,
        starts: Mapping[str, SurfaceClassifier],
        head_factor: float,
        head_start: str = "scores",
    ) -> None:
        if not MIN_FACTOR <= head_factor <= MAX_FACTOR:
            raise UserError(
                f"model.fusion.fit.head_factor is {head_factor:g}; "
                f"choose a value from {MIN_FACTOR:g} to {MAX_FACTOR:g}."
            )
        self.starts = starts
        self.head_factor = head_factor
        self.head_start = head_start

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Fill in weights and features; a resumed run overwrites them with its own later."""
        if stage != "fit" or not isinstance(pl_module, FusionModule):
            return
        target, head = pl_module.classifier, pl_module.network.head
        networks = []
        for name, start in self.starts.items():
            target.sense(name).adopt(start.cpu().sense(name))
            networks.append(start.network)
        fused = FusionNet(*networks, classes=len(target.card.classes), **target.card.fusion)
        if self.head_start == "scores":
            fused.start_from_scores(*networks)
        else:
            fused.head.load_state_dict(head.state_dict())  # drawn from the run's own seed
        target.network = fused
        pl_module.head_factor = self.head_factor

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """State the rates; each step's are logged as lr/backbone and lr/head."""
        groups = trainer.optimizers[0].param_groups  # no backbone where nothing in it is trained
        log.debug(
            "FusionNet starts from the networks of %s; learning rate of the %s.",
            " and ".join(self.starts),
            " and ".join(f"{group['name']} {group['lr']:.3g}" for group in groups),
        )
