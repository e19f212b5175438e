"""The networks: plain PyTorch modules from features to dense class scores."""

from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

__all__ = ["FusionNet", "HapticNet", "VisualNet"]
