"""Convolutional trunks of VisualNet, by the name used in the configuration."""

from tex_lightning.networks.trunks.alexnet import CaffeAlexNet, TorchvisionAlexNet
from tex_lightning.networks.trunks.base import Trunk
from tex_lightning.networks.trunks.squeezenet import SqueezeNetTrunk
from tex_lightning.networks.trunks.tcnn import TcnnTrunk

TRUNKS: dict[str, type[Trunk]] = {
    "alexnet_caffe": CaffeAlexNet,
    "alexnet_torchvision": TorchvisionAlexNet,
    "tcnn": TcnnTrunk,
    "squeezenet": SqueezeNetTrunk,
}

__all__ = ["TRUNKS", "Trunk"]
