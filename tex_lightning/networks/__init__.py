"""Networks as plain PyTorch modules, from features to class scores at every position.

HapticNet and VisualNet are the convolutional networks of the paper, and FusionNet joins them.
LinearNet is fitted in closed form. Trunks are the backbones of VisualNet.
"""

from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

__all__ = ["FusionNet", "HapticNet", "VisualNet"]
