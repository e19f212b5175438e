"""Networks as plain PyTorch modules, from features to class scores at every position.

HapticNet and VisualNet are the convolutional networks of the paper, and FusionNet joins them.
Trunks are the backbones of VisualNet.

LinearNet (:mod:`.linear`) is fitted in closed form: its rows (:mod:`.rows`) are scored by a ridge
regression (:mod:`.ridge`), whose settings are chosen by leaving rows out (:mod:`.line_fit`). What
scores a recording in the end is :mod:`.line`: that line, or what takes its place for recordings
that are short, of another gain, or out of :mod:`.range`, or where classes are :mod:`.planes`.
"""

from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet

__all__ = ["FusionNet", "HapticNet", "VisualNet"]
