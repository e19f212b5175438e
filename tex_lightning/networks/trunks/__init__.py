"""Trunks: the backbones of VisualNet, by the names of their published weights."""

from tex_lightning.networks.blocks import Norm
from tex_lightning.networks.trunks.alexnet import CaffeAlexNet, TcnnTrunk
from tex_lightning.networks.trunks.base import Trunk
from tex_lightning.networks.trunks.efficientnet_lite import EfficientNetLite0, EfficientNetLite2
from tex_lightning.networks.trunks.vgg_m import VggMTrunk

TRUNKS: dict[str, type[Trunk]] = {
    "alexnet_caffe": CaffeAlexNet,
    "tcnn": TcnnTrunk,
    "vgg_m": VggMTrunk,
    "efficientnet_lite0": EfficientNetLite0,
    "efficientnet_lite2": EfficientNetLite2,
}

__all__ = ["TRUNKS", "Trunk", "name_trunk", "published"]


def published(name: str) -> Trunk:
    """Return a trunk that its published weights fit, with random ones."""
    cls = TRUNKS[name]
    norm: Norm = "lrn" if "lrn" in cls.norms else "none"
    return cls(width=1, norm=norm)


def name_trunk(cls: type[Trunk]) -> str:
    """Return the name of a class of trunks: its published name, or that of the class."""
    return next((name for name, known in TRUNKS.items() if known is cls), cls.__name__)
