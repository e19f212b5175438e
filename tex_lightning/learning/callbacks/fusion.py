"""Start FusionNet from trained unimodal networks, with a faster head (paper, section III-B)."""

import logging
from pathlib import Path
from typing import cast

from lightning import LightningModule, Trainer
from lightning.pytorch.callbacks import Callback

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config.model import MAX_FACTOR, MIN_FACTOR
from tex_lightning.errors import UserError
from tex_lightning.learning.fusion import FusionModule
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

log = logging.getLogger(__name__)


class FusionStart(Callback):
    """Load the unimodal checkpoints and set the learning rate of the fusion layer.

    Args:
        haptic_checkpoint: Of a HapticNet.
        visual_checkpoint: Of a VisualNet.
        head_factor: Learning rate of the fusion layer over that of the networks, 10 to 50.
        head_start: ``scores`` begins with the sum of both networks' class scores, ``random`` with
            small random weights.

    Raises:
        UserError: If the factor is outside the paper's range.
    """

    def __init__(
        self,
        haptic_checkpoint: Path,
        visual_checkpoint: Path,
        head_factor: float,
        head_start: str = "scores",
    ) -> None:
        if not MIN_FACTOR <= head_factor <= MAX_FACTOR:
            raise UserError(
                f"model.fusion.fit.head_factor is {head_factor:g}; "
                f"choose a value from {MIN_FACTOR:g} to {MAX_FACTOR:g}."
            )
        self.haptic_checkpoint = haptic_checkpoint
        self.visual_checkpoint = visual_checkpoint
        self.head_factor = head_factor
        self.head_start = head_start

    def setup(self, trainer: Trainer, pl_module: LightningModule, stage: str) -> None:
        """Fill in weights and features; a resumed run overwrites them with its own later."""
        if stage != "fit" or not isinstance(pl_module, FusionModule):
            return
        target = pl_module.classifier
        haptic = SurfaceClassifier.from_checkpoint(self.haptic_checkpoint, "haptic")
        visual = SurfaceClassifier.from_checkpoint(self.visual_checkpoint, "visual")
        target.adopt_haptic_features(haptic)
        head = pl_module.network.head
        parts = cast(HapticNet, haptic.network), cast(VisualNet, visual.network)
        network = FusionNet(*parts, classes=len(target.card.classes), level=pl_module.network.level)
        if self.head_start == "scores":
            network.start_from_scores(*parts)
        else:
            network.head.load_state_dict(head.state_dict())  # drawn from the run's own seed
        target.network = network
        pl_module.head_factor = self.head_factor

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """State both rates; each step's are logged as lr/backbone and lr/head."""
        rates = {group["name"]: group["lr"] for group in trainer.optimizers[0].param_groups}
        log.info(
            "FusionNet starts from %s and %s; learning rate %.3g, head %.3g.",
            self.haptic_checkpoint.name,
            self.visual_checkpoint.name,
            rates["backbone"],
            rates["head"],
        )
