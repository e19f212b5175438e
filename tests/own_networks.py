"""Networks as users bring them, on spectrograms (B, 1, 50, frames): ``own_networks.NAME``."""

from collections.abc import Callable

import torch
from torch import Tensor, nn
from torch.nn.utils import spectral_norm as hooked_norm
from torch.nn.utils.parametrizations import spectral_norm, weight_norm

Layers = list[nn.Module]


def conv(inputs: int, outputs: int, **how: object) -> nn.Conv2d:
    how = {"padding": 1} | how
    return nn.Conv2d(inputs, outputs, 3, **how)


def body(*layers: nn.Module) -> nn.Sequential:
    return nn.Sequential(conv(1, 8), nn.ReLU(), *layers, nn.ReLU())


class Stack(nn.Module):
    """Layers, a mean over the bands, and scores of every frame."""

    trunk = "an attribute that is no part of a network"

    def __init__(self, classes: int, layers: nn.Module) -> None:
        super().__init__()
        self.layers = layers
        self.score_layer = nn.Conv1d(8, classes, 1)

    def features(self, x: Tensor, level: str) -> Tensor:
        hidden = self.hidden(x)
        return hidden if level == "fc2" else self.score_layer(hidden)

    def hidden(self, x: Tensor) -> Tensor:
        return self.layers(x).mean(2)


SHAPES: dict[str, Callable[[], nn.Module]] = {
    "starts_with_norm": lambda: nn.Sequential(nn.BatchNorm2d(1), nn.ReLU(), conv(1, 8)),
    "pre_activation": lambda: body(nn.BatchNorm2d(8), nn.ReLU(), conv(8, 8)),
    "pre_activation_blocks": lambda: nn.Sequential(
        conv(1, 8), *(nn.Sequential(nn.BatchNorm2d(8), nn.ReLU(), conv(8, 8)) for _ in range(2))
    ),
    "pool_then_norm_at_the_start": lambda: nn.Sequential(
        conv(1, 8), nn.Sequential(nn.MaxPool2d(2), nn.BatchNorm2d(8), conv(8, 8))
    ),
    "norm_twice": lambda: body(conv(8, 8), nn.BatchNorm2d(8), nn.BatchNorm2d(8)),
    "response_norm": lambda: body(nn.LocalResponseNorm(5, alpha=0.1)),
    "response_norm_of_three": lambda: body(nn.LocalResponseNorm(3, alpha=0.5, beta=0.5)),
    "response_norm_of_even_size": lambda: body(nn.LocalResponseNorm(4, alpha=0.5)),
    "norm_without_weights": lambda: body(conv(8, 8), nn.BatchNorm2d(8, affine=False)),
    "norm_without_statistics": lambda: body(
        conv(8, 8), nn.BatchNorm2d(8, track_running_stats=False)
    ),
    "grouped": lambda: body(conv(8, 8, groups=4), nn.BatchNorm2d(8)),
    "depthwise": lambda: body(conv(8, 8, groups=8), nn.BatchNorm2d(8), nn.Conv2d(8, 8, 1)),
    "transposed": lambda: body(nn.ConvTranspose2d(8, 8, 3, stride=2), nn.BatchNorm2d(8)),
    "dilated": lambda: body(conv(8, 8, dilation=2), nn.BatchNorm2d(8)),
    "same_and_reflect": lambda: body(
        conv(8, 8, padding="same"), nn.BatchNorm2d(8), conv(8, 8, padding_mode="reflect"),
        nn.BatchNorm2d(8),
    ),
    "group_norm": lambda: body(conv(8, 8), nn.GroupNorm(2, 8)),
    "instance_norm": lambda: body(conv(8, 8), nn.InstanceNorm2d(8, affine=True)),
    "instance_norm_with_statistics": lambda: body(
        conv(8, 8), nn.InstanceNorm2d(8, track_running_stats=True)
    ),
    "weight_norm": lambda: body(weight_norm(conv(8, 8)), nn.BatchNorm2d(8)),
    "norm_by_hooks": lambda: body(hooked_norm(conv(8, 8)), nn.BatchNorm2d(8)),
    "spectral_norm": lambda: body(spectral_norm(conv(8, 8)), nn.BatchNorm2d(8)),
    "pool_indices": lambda: body(conv(8, 8), First(nn.MaxPool2d(2, return_indices=True))),
}  # fmt: skip


class First(nn.Module):
    """The first output of a layer."""

    def __init__(self, layer: nn.Module) -> None:
        super().__init__()
        self.layer = layer

    def forward(self, x: Tensor) -> Tensor:
        return self.layer(x)[0]


class Shape(Stack):
    """One of :data:`SHAPES`."""

    def __init__(self, classes: int, shape: str) -> None:
        super().__init__(classes, SHAPES[shape]())


class Residual(Stack):
    """A block whose input is added to its output; its first layer must not overwrite it."""

    def __init__(self, classes: int) -> None:
        block = nn.Sequential(nn.LocalResponseNorm(5, alpha=0.5), conv(8, 8), nn.BatchNorm2d(8))
        super().__init__(classes, block)
        self.first = conv(1, 8)

    def hidden(self, x: Tensor) -> Tensor:
        x = self.first(x)
        return (x + self.layers(x)).relu().mean(2)


class Shared(Stack):
    """A convolution that stands at two places, each with its own normalisation."""

    def __init__(self, classes: int) -> None:
        both = conv(8, 8)
        super().__init__(classes, body(both, nn.BatchNorm2d(8), both, nn.BatchNorm2d(8)))


class Tied(Stack):
    """Two convolutions of one weight."""

    def __init__(self, classes: int) -> None:
        layers = body(conv(8, 8), nn.BatchNorm2d(8), conv(8, 8))
        layers[4].weight = layers[2].weight
        super().__init__(classes, layers)


class Twice(Stack):
    """A block that is run twice."""

    def __init__(self, classes: int) -> None:
        super().__init__(classes, nn.Sequential(conv(8, 8), nn.BatchNorm2d(8)))
        self.first = conv(1, 8)

    def hidden(self, x: Tensor) -> Tensor:
        return self.layers(self.layers(self.first(x)).relu()).mean(2)


class Taken(Stack):
    """Layers of a ``Sequential`` that are also used one by one, which no pattern tells."""

    def __init__(self, classes: int) -> None:
        super().__init__(classes, nn.Sequential(conv(1, 8), nn.BatchNorm2d(8)))

    def hidden(self, x: Tensor) -> Tensor:
        return (self.layers(x) + self.layers[0](x)).relu().mean(2)


class Backwards(nn.Sequential):
    """A ``Sequential`` that runs from its end."""

    def forward(self, x: Tensor) -> Tensor:
        for layer in reversed(self):
            x = layer(x)
        return x


class Headed(Stack):
    """Layers named as those of this package's networks, which they are not."""

    def __init__(self, classes: int) -> None:
        super().__init__(classes, body())
        self.head = nn.Sequential(nn.Conv1d(8, 8, 1), nn.ReLU())
        self.min_size, self.window_size = 5, "any"

    def hidden(self, x: Tensor) -> Tensor:
        return self.head(super().hidden(x))


class Reversed(Stack):
    """A sequence with a ``forward`` of its own."""

    def __init__(self, classes: int) -> None:
        super().__init__(classes, Backwards(conv(8, 8), nn.BatchNorm2d(8), conv(1, 8)))


class Viewed(Stack):
    """``view`` of a map, which takes its channels outermost."""

    def __init__(self, classes: int) -> None:
        super().__init__(classes, body(conv(8, 8), nn.BatchNorm2d(8)))

    def hidden(self, x: Tensor) -> Tensor:
        x = self.layers(x)
        return x.view(len(x), -1, x.shape[-1])[:, :8]


class Solid(Stack):
    """A convolution along three axes."""

    def __init__(self, classes: int) -> None:
        super().__init__(classes, nn.Conv3d(1, 8, 3, padding=1))

    def hidden(self, x: Tensor) -> Tensor:
        return self.layers(x[:, None]).mean((2, 3))


class Recurrent(Stack):
    """A recurrent network over the frames; what it gave last is kept."""

    def __init__(self, classes: int) -> None:
        super().__init__(classes, nn.LSTM(50, 4, batch_first=True, bidirectional=True))
        self.kept: list[Tensor] = []
        self.head = None

    def hidden(self, x: Tensor) -> Tensor:
        self.last = self.layers(x[:, 0].mT)[0].mT
        self.kept = [self.last]
        return self.last


class Signals(Stack):
    """Layers along one axis, with the response norm of signals."""

    def __init__(self, classes: int) -> None:
        norm, response = nn.BatchNorm1d(8), nn.LocalResponseNorm(5, alpha=0.1)
        super().__init__(classes, nn.Sequential(nn.Conv1d(50, 8, 3), norm, nn.ReLU(), response))

    def hidden(self, x: Tensor) -> Tensor:
        return self.layers(x[:, 0])


OTHERS = (Residual, Shared, Tied, Twice, Taken, Headed, Reversed, Viewed, Solid, Recurrent, Signals)
NODES = [{"_target_": "own_networks.Shape", "shape": shape} for shape in SHAPES]
NODES += [{"_target_": f"own_networks.{cls.__name__}"} for cls in OTHERS]


def settle(network: nn.Module) -> None:
    """Give weights and statistics values as training leaves them, some scales negative."""
    for module in network.modules():
        if isinstance(module, nn.modules.batchnorm._NormBase):
            if module.affine:
                nn.init.uniform_(module.weight, -0.5, 1.5)
                nn.init.normal_(module.bias)
            if module.track_running_stats:
                nn.init.normal_(module.running_mean, std=0.5)
                nn.init.uniform_(module.running_var, 0.3, 3.0)
    torch.manual_seed(0)
