"""HapticNet: the fully convolutional network on spectrograms of acceleration traces."""

from typing import Annotated

from torch import Tensor, nn

from tex_lightning.networks.blocks import (
    NORMS,
    PROBABILITY,
    WIDTH,
    Head,
    Level,
    Norm,
    Window,
    check_norm,
    conv_block,
    initialise,
    response_norm,
    scaled,
)
from tex_lightning.networks.geometry import layer_windows, side_after

POOL = Window(2, 2, ceil=True)
CHANNELS = (50, 100, 150, 200)
FINAL_CHANNELS = 400
FINAL_KERNEL = (4, 12)
HIDDEN_CHANNELS = 250


class HapticNet(nn.Module):
    """Classify every 16th position of a spectrogram (paper, Table "HapticNet-structure").

    Four 3x3 convolutions with padding 1, each followed by 2x2 max pooling and ReLU, reduce 50
    frequency bands to 4; an unpadded convolution over 4 bands and 12 positions joins them.
    The paper leaves padding and pooling mode open: padding 1 with ceil-mode pooling is the only
    choice for which the 4x12 convolution fits and 50x192 gives exactly one prediction.

    Args:
        classes: Number of materials.
        width: Factor on every channel count except ``classes``; 1 is the paper's size.
        norm: "lrn" is the paper's network, with one local response normalisation after the first
            pooling; "batch" normalises before every ReLU and trains from scratch in far
            fewer steps; "none" does neither.
        dropout: Probability of dropping an input of the two 1x1 layers while training.

    Raises:
        UserError: ``norm`` is not one of the three.

    Example:
        >>> import tex_lightning as tl, torch
        >>> network = tl.HapticNet(classes=3, width=0.1).eval()
        >>> network(torch.rand(1, 1, 50, 400)).shape  # 400 frames, 4 s
        torch.Size([1, 3, 14])
    """

    stride = 16  # frames between neighbouring predictions
    window_size = (50, 192)  # bands and frames that give exactly one prediction
    min_size = (50, 177)

    def __init__(
        self,
        classes: int,
        *,
        width: Annotated[
            float, WIDTH, "factor on every channel count; 1 is the paper's size"
        ] = 0.48,
        norm: Annotated[Norm, "normalisation of activations; lrn is the paper's"] = "batch",
        dropout: Annotated[
            float, PROBABILITY, "probability of dropping an input of the 1x1 layers"
        ] = 0.2,
    ) -> None:
        super().__init__()
        check_norm(norm, NORMS, "model.haptic.norm")
        self.classes = classes
        self.hidden = scaled(HIDDEN_CHANNELS, width)
        layers: list[nn.Module] = []
        source, final = 1, scaled(FINAL_CHANNELS, width)
        for index, channels in enumerate(CHANNELS):
            target = scaled(channels, width)
            conv, *rest = conv_block(source, target, 3, norm=norm, padding=1)
            # ReLU commutes with the maximum, and pooling first leaves it, and batch normalisation,
            # a quarter of the elements.
            layers += [conv, POOL.max_pool(), *rest]
            if index == 0:
                layers += response_norm(norm)
            source = target
        layers.append(conv_block(source, final, FINAL_KERNEL, norm=norm))
        self.trunk = nn.Sequential(*layers)
        initialise(self.trunk)
        hidden = nn.Sequential(nn.Dropout(dropout), conv_block(final, self.hidden, 1, norm=norm))
        self.head = Head(hidden, self.hidden, classes, dropout)

    def forward(self, x: Tensor) -> Tensor:
        """Map a spectrogram (B, 1, 50, T) to class scores before softmax (B, classes, L)."""
        return self.features(x, "fc3")

    def features(self, x: Tensor, level: Level) -> Tensor:
        """Return the features (B, D, L) that fusion samples from, L as in ``output_size(50, T)``.

        Args:
            x: Spectrogram (B, 1, 50, T), no smaller than ``min_size``.
            level: "fc2" for the activations of the last hidden layer after ReLU, "fc3" for the
                class scores before softmax.
        """
        scores: Tensor = self.head(self.trunk(x), level)
        return scores.squeeze(2)

    @property
    def score_layer(self) -> nn.Conv2d:
        """FC3."""
        return self.head.score_layer

    def output_size(self, bands: int, frames: int) -> tuple[int, int]:
        """Return rows and columns of predictions for a spectrogram; 0 where it is too small."""
        rows, columns = layer_windows(self, 0), layer_windows(self, 1)
        return side_after(rows, bands), side_after(columns, frames)
