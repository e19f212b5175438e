"""VisualNet: the fully convolutional network on photos of surfaces."""

from collections.abc import Sequence
from typing import cast

from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import Head, Level, Norm, Window, conv_block, scaled
from tex_lightning.networks.trunks import TRUNKS, Trunk
from tex_lightning.networks.trunks.squeezenet import SqueezeNetTrunk


class VisualNet(nn.Module):
    """Classify a photo densely: a convolutional trunk and three convolutions FC1, FC2, FC3.

    The paper speaks of 1x1 convolutions throughout, yet of one prediction for 224x224, where
    AlexNet's last map is 6x6. FC1 therefore takes a 6x6 kernel on the AlexNet trunks (5,191,749
    parameters for 69 classes); ``fc1_kernel=1`` is the literal reading, with 36 predictions.

    Args:
        classes: Number of materials.
        trunk: "alexnet_caffe" is the paper's VisualNet, "tcnn" its VisualNet-TCNN;
            "alexnet_torchvision" and "squeezenet" have ImageNet weights at hand.
        width: Factor on every channel count except ``classes``; 1 is the published size.
        norm: "batch" trains from scratch; "lrn" is the paper's, for the Caffe trunks; "none" for
            pretrained trunks without normalisation.
        dropout: Probability of dropping an input of FC2 and FC3 while training.
        fc1_kernel: Side of FC1's kernel; None takes the trunk's.
        head: Channel counts of FC1 and FC2, before ``width``; none lets FC3 score the trunk's
            features as they are, which are then those of level "fc2".
        fragment: Side in pixels of an input that gives one prediction, of SqueezeNet; None takes
            the trunk's.

    Attributes:
        patch: Side in pixels of an input that gives one prediction (with the trunk's FC1).
        min_side: Smallest side in pixels that gives a prediction.
        stride: Pixels between neighbouring predictions.

    Raises:
        UserError: The trunk is unknown or cannot have this normalisation, or needs an FC1.

    Example:
        >>> import tex_lightning as tl, torch
        >>> network = tl.VisualNet(classes=3, width=0.1).eval()
        >>> network(torch.rand(1, 3, 300, 400)).shape
        torch.Size([1, 3, 4, 7])
    """

    def __init__(
        self,
        classes: int,
        *,
        trunk: str = "alexnet_caffe",
        width: float = 1.0,
        norm: Norm = "batch",
        dropout: float = 0.5,
        fc1_kernel: int | None = None,
        head: Sequence[int] = (300, 250),
        fragment: int | None = None,
    ) -> None:
        super().__init__()
        if trunk not in TRUNKS:
            raise UserError(
                f"model.visual.trunk={trunk} is unknown; choose one of {', '.join(TRUNKS)}."
            )
        self.trunk = _make_trunk(trunk, width, norm, fragment)
        self.fc1_kernel = self.trunk.fc1_kernel if fc1_kernel is None else fc1_kernel
        self.patch = self.trunk.patch
        self.min_side = self.trunk.smallest_side(self.fc1_kernel)
        self.stride = self.trunk.stride
        self.classes = classes
        hidden, self.hidden = nn.Sequential(), self.trunk.out_channels
        if head:
            fc1, self.hidden = (scaled(channels, width) for channels in head)
            hidden = nn.Sequential(
                conv_block(self.trunk.out_channels, fc1, self.fc1_kernel, norm=norm),
                nn.Dropout(dropout),
                conv_block(fc1, self.hidden, 1, norm=norm),
            )
        elif not self.trunk.textures:
            raise UserError(
                f"model.visual.head=[] lets FC3 score the features of {trunk} as they are, and "
                "only those of squeezenet are made for it; give channels of FC1 and FC2."
            )
        self.head = Head(hidden, self.hidden, classes, dropout)

    def forward(self, x: Tensor) -> Tensor:
        """Map images to class scores before softmax (B, classes, M, N).

        Args:
            x: RGB images (B, 3, H, W), values in [0, 1] less the ImageNet mean (0.485, 0.456,
                0.406), divided by its standard deviation (0.229, 0.224, 0.225), for every trunk.
        """
        return self.features(x, "fc3")

    def features(self, x: Tensor, level: Level) -> Tensor:
        """Return the features that fusion samples from.

        Args:
            x: Images as for ``forward``, no side smaller than ``min_side``.
            level: "fc2" for the activations of the last hidden layer after ReLU, "fc3" for the
                class scores before softmax.

        Returns:
            (B, D, M, N) with D = ``feature_size(level)`` and (M, N) = ``output_size(H, W)``.
        """
        features: Tensor = self.head(self.trunk(x), level)
        return features

    @property
    def fc1(self) -> nn.Conv2d:
        """FC1, the first convolution on the trunk's features."""
        return cast(nn.Conv2d, cast(nn.Sequential, self.head.hidden[0])[0])

    @property
    def has_hidden_layers(self) -> bool:
        """Whether there are FC1 and FC2 before FC3."""
        return len(self.head.hidden) > 0

    def feature_size(self, level: Level) -> int:
        """Return the channel count of ``features`` at ``level``."""
        return self.hidden if level == "fc2" else self.classes

    def output_size(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of predictions for an image in pixels; 0 where too small."""
        fc1 = Window(self.fc1_kernel)
        rows, columns = (fc1.output(self.trunk.output_side(side)) for side in (height, width))
        return rows, columns


def _make_trunk(name: str, width: float, norm: Norm, fragment: int | None) -> Trunk:
    if fragment is None:
        return TRUNKS[name](width=width, norm=norm)
    if not issubclass(TRUNKS[name], SqueezeNetTrunk):
        raise UserError(
            f"model.visual.fragment={fragment} sets the window of squeezenet's features, and "
            f"{name} has its own; leave it out."
        )
    return SqueezeNetTrunk(width=width, norm=norm, patch=fragment)
