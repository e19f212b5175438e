"""VisualNet: the fully convolutional network on photos of surfaces."""

from collections.abc import Sequence
from typing import Annotated

from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import PROBABILITY, Head, Level, Window, conv_block, scaled
from tex_lightning.networks.trunks import Trunk, name_trunk


class VisualNet(nn.Module):
    """Classify a photo densely: a convolutional trunk and three convolutions FC1, FC2, FC3.

    The paper has 1x1 convolutions throughout, yet one prediction for 224x224, where
    AlexNet's last map is 6x6. FC1 therefore takes a 6x6 kernel on the AlexNet trunks (5,191,749
    parameters for 69 classes); ``fc1_kernel=1`` is the literal reading, with 36 predictions.

    Args:
        classes: Number of materials.
        trunk: Convolutions before FC1, whose width and normalisation FC1 and FC2 have too.
        dropout: Probability of dropping an input of FC2 and FC3 while training.
        fc1_kernel: Side of FC1's kernel; None takes the trunk's.
        head: Channel counts of FC1 and FC2, before ``width``; none lets FC3 score the trunk's
            features as they are, which are then those of level "fc2".

    Attributes:
        window_size: Height and width in pixels of an input that gives exactly one prediction: the
            trunk's patch, or with another FC1, where a patch gives several, the smallest image.
        min_size: Smallest height and width in pixels that give a prediction.

    Raises:
        UserError: The trunk is none, or needs an FC1.

    Example:
        >>> import tex_lightning as tl, torch
        >>> from tex_lightning.networks.trunks.alexnet import CaffeAlexNet
        >>> network = tl.VisualNet(3, CaffeAlexNet(width=0.1, norm="batch")).eval()
        >>> network(torch.rand(1, 3, 300, 400)).shape
        torch.Size([1, 3, 4, 7])
    """

    def __init__(
        self,
        classes: int,
        trunk: Annotated[Trunk, "class of the convolutions before FC1, and its keys"],
        *,
        dropout: Annotated[
            float, PROBABILITY, "probability of dropping an input of FC2 and FC3"
        ] = 0.2,
        fc1_kernel: Annotated[
            int | None, "[1, 64]", "side of FC1's kernel; null: the trunk's"
        ] = None,
        head: Annotated[
            Sequence[int], "[1, 16384]", "channels of FC1 and FC2 before the width; []: FC3 alone"
        ] = (300, 250),
    ) -> None:
        super().__init__()
        if not isinstance(trunk, Trunk):
            raise UserError(
                f"The trunk of VisualNet is a {type(trunk).__name__}, which is no trunk; derive it "
                f"from {Trunk.__module__}.{Trunk.__name__}."
            )
        self.trunk, norm = trunk, trunk.norm
        self.fc1_kernel = self.trunk.fc1_kernel if fc1_kernel is None else fc1_kernel
        least, patch = self.trunk.smallest_side(self.fc1_kernel), self.trunk.patch
        side = patch if self.output_size(patch, patch) == (1, 1) else least
        self.window_size, self.min_size = (side, side), (least, least)
        self.classes = classes
        hidden, self.hidden = nn.Sequential(), self.trunk.out_channels
        if head:
            fc1, self.hidden = (scaled(channels, trunk.width) for channels in head)
            hidden = nn.Sequential(
                conv_block(self.trunk.out_channels, fc1, self.fc1_kernel, norm=norm),
                nn.Dropout(dropout),
                conv_block(fc1, self.hidden, 1, norm=norm),
            )
        elif not self.trunk.textures:
            raise UserError(
                f"model.visual.head=[] lets FC3 score the features of {name_trunk(type(trunk))} as "
                "they are, and only those of efficientnet_lite0 and efficientnet_lite2 are made "
                "for it; give channels of FC1 and FC2."
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
        """Return the features (B, D, M, N) that fusion samples from, at ``output_size(H, W)``.

        Args:
            x: Images as for ``forward``, no smaller than ``min_size``.
            level: "fc2" for the activations of the last hidden layer after ReLU, "fc3" for the
                class scores before softmax.
        """
        features: Tensor = self.head(self.trunk(x), level)
        return features

    @property
    def stride(self) -> int:
        """Pixels between neighbouring predictions."""
        return self.trunk.stride

    @property
    def score_layer(self) -> nn.Conv2d:
        """FC3."""
        return self.head.score_layer

    @property
    def has_hidden_layers(self) -> bool:
        """Whether there are FC1 and FC2 before FC3."""
        return len(self.head.hidden) > 0

    def output_size(self, height: int, width: int) -> tuple[int, int]:
        """Return rows and columns of predictions for an image in pixels; 0 where too small."""
        fc1 = Window(self.fc1_kernel)
        rows, columns = (fc1.output(self.trunk.output_side(side)) for side in (height, width))
        return rows, columns
