"""The networks: features in, dense class scores out; plain PyTorch modules."""

from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

__all__ = ["FusionNet", "HapticNet", "VisualNet"]
