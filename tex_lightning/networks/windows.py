"""The same weights as a classifier of one window that slides over the input, to compare with.

The paper compares its networks with such twins (section IV, "Time profiling").
"""

from collections.abc import Iterator
from copy import deepcopy
from typing import Any

import torch
from torch import Tensor, nn


class WindowNet(nn.Module):
    """A CNN for one window: the network's layers, with its head as fully connected layers.

    FC1 to FC3 become ``nn.Linear`` on the flattened features of the trunk, with the same weights.
    HapticNet's 4x12 convolution stays one, as in the paper's table. A network that is not made of
    a ``trunk`` and a ``head`` is taken as it is.

    Args:
        network: With ``features(x, level)``; it is copied.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        whole: Any = deepcopy(network)
        self.trunk, self.head = whole, nn.Sequential(nn.Flatten())
        self.connected = hasattr(whole, "trunk") and hasattr(whole, "head")
        if self.connected:
            leaves = [leaf for leaf in whole.head.modules() if not list(leaf.children())]
            self.trunk = whole.trunk
            self.head.extend(map(_connected, leaves))
        self.train(network.training)

    def forward(self, windows: Tensor) -> Tensor:
        """Map windows (B, C, height, width) to class scores before softmax (B, classes)."""
        features = self.trunk(windows) if self.connected else scores(self.trunk, windows)
        class_scores: Tensor = self.head(features)
        return class_scores


def scores(network: Any, x: Tensor) -> Tensor:  # noqa: ANN401
    """Class scores (B, classes, *positions) of a network's inputs."""
    found: Tensor = network.features(x, "fc3")
    return found


@torch.no_grad()
def _connected(layer: nn.Module) -> nn.Module:
    """The layer for flattened features."""
    if isinstance(layer, nn.Conv2d):
        weight = layer.weight.flatten(1)
        linear = nn.Linear(weight.shape[1], len(weight))
        linear.weight, linear.bias = nn.Parameter(weight), layer.bias  # type: ignore[assignment]
        return linear
    if isinstance(layer, nn.BatchNorm2d):
        norm = nn.BatchNorm1d(layer.num_features, layer.eps, layer.momentum)
        norm.load_state_dict(layer.state_dict())
        return norm.to(layer.weight.device)
    return layer


def cut_windows(x: Tensor, size: tuple[int, int], step: int) -> Tensor:
    """Full windows of an input, as far apart as the predictions of the network.

    Window (i, j) starts where prediction (i, j) of the whole input does. The network's ceil-mode
    pooling adds predictions at the far ends, for which no full window is left.

    Args:
        x: One input (1, C, H, W).
        size: Height and width of a window.
        step: Elements from one to the next, either way.

    Returns:
        A view (rows, columns, C, *size); a spectrogram has one row.
    """
    height, width = size
    return x[0].unfold(1, height, step).unfold(2, width, step).permute(1, 2, 0, 3, 4)


def batches(grid: Tensor, size: int) -> Iterator[Tensor]:
    """Copy windows row by row into batches (B, C, height, width) of at most ``size``."""
    rows, columns = grid.shape[:2]
    places = torch.arange(rows * columns, device=grid.device)
    for begin in range(0, len(places), size):
        chosen = places[begin : begin + size]
        yield grid[chosen // columns, chosen % columns]


def dense_grid(dense: Tensor) -> Tensor:
    """Bring a network's dense output for one input to (rows, columns, classes)."""
    return dense[0].reshape(dense.shape[1], -1, dense.shape[-1]).permute(1, 2, 0)
