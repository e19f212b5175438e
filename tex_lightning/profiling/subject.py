"""What a profile is of."""

from dataclasses import dataclass
from typing import cast

from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet


@dataclass(frozen=True)
class Subject:
    """A unimodal classifier and what it is to classify.

    Attributes:
        classifier: In evaluation mode, as trained.
        recording: Decoded trace (axes, samples) or photo (height, width, 3).
    """

    classifier: SurfaceClassifier
    recording: Tensor

    @property
    def network(self) -> HapticNet | VisualNet:
        """The network inside."""
        return cast(HapticNet | VisualNet, self.classifier.network)

    def features(self, classifier: SurfaceClassifier) -> Tensor:
        """Network input (1, C, H, W) of the recording, as this or an equal classifier has it."""
        if self.classifier.card.kind == "haptic":
            return classifier.haptic_input(self.recording)
        return classifier.visual_input(self.recording)
