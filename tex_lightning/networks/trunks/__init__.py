"""Convolutional trunks of VisualNet, by the name used in the configuration."""

from tex_lightning.networks.trunks.alexnet import CaffeAlexNet, TorchvisionAlexNet
from tex_lightning.networks.trunks.base import Trunk
from tex_lightning.networks.trunks.squeezenet import SqueezeNetTrunk
from tex_lightning.networks.trunks.tcnn import TcnnTrunk
from tex_lightning.networks.trunks.vgg_m import VggMTrunk

TRUNKS: dict[str, type[Trunk]] = {
    "alexnet_caffe": CaffeAlexNet,
    "alexnet_torchvision": TorchvisionAlexNet,
    "tcnn": TcnnTrunk,
    "squeezenet": SqueezeNetTrunk,
    "vgg_m": VggMTrunk,
}

__all__ = ["TRUNKS", "Trunk"]
