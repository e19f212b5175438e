"""The same weights as a classifier of one window, slid over the input: what an FCN saves.

The paper compares its networks with such twins (section IV, "Time profiling").
"""

from collections.abc import Iterator
from copy import deepcopy

import torch
from torch import Tensor, nn

from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.visualnet import VisualNet


class WindowNet(nn.Module):
    """A CNN for one window: the network's layers, with its head as fully connected layers.

    FC1 to FC3 become ``nn.Linear`` on the flattened features of the trunk, with the same weights.
    HapticNet's 4x12 convolution stays one, as in the paper's table.

    Args:
        network: HapticNet or VisualNet; it is copied.
    """

    def __init__(self, network: HapticNet | VisualNet) -> None:
        super().__init__()
        self.trunk = deepcopy(network.trunk)
        leaves = [leaf for leaf in network.head.modules() if not list(leaf.children())]
        self.head = nn.Sequential(nn.Flatten(), *map(_connected, leaves))
        self.train(network.training)

    def forward(self, windows: Tensor) -> Tensor:
        """Map windows (B, C, *window_size) to class scores before softmax (B, classes)."""
        scores: Tensor = self.head(self.trunk(windows))
        return scores


def _connected(layer: nn.Module) -> nn.Module:
    """The layer for flattened features."""
    if isinstance(layer, nn.Conv2d):
        weight = layer.weight.detach().flatten(1)
        linear = nn.Linear(weight.shape[1], len(weight), bias=layer.bias is not None)
        with torch.no_grad():
            linear.weight.copy_(weight)
            if layer.bias is not None:
                linear.bias.copy_(layer.bias)
        return linear.to(weight.device)
    if isinstance(layer, nn.BatchNorm2d):
        norm = nn.BatchNorm1d(layer.num_features, layer.eps, layer.momentum)
        norm.load_state_dict(layer.state_dict())
        return norm.to(layer.weight.device)
    return deepcopy(layer)


def window_size(network: HapticNet | VisualNet) -> tuple[int, int]:
    """Height and width of an input that gives exactly one prediction.

    That is 50 bands by 192 frames, or a patch; with another FC1 than the trunk's, where a patch
    gives several predictions, the smallest image.
    """
    if isinstance(network, HapticNet):
        return network.bands, network.window
    single = network.output_size(network.patch, network.patch) == (1, 1)
    side = network.patch if single else network.min_side
    return side, side


def cut_windows(network: HapticNet | VisualNet, x: Tensor) -> Tensor:
    """Full windows of an input, as far apart as the predictions of the network.

    Window (i, j) starts where prediction (i, j) of the whole input does. The network's ceil-mode
    pooling adds predictions at the far ends, for which no full window is left.

    Args:
        network: Whose windows.
        x: One input (1, C, H, W).

    Returns:
        A view (rows, columns, C, *window_size); a spectrogram has one row.
    """
    height, width = window_size(network)
    step = network.stride
    return x[0].unfold(1, height, step).unfold(2, width, step).permute(1, 2, 0, 3, 4)


def batches(grid: Tensor, size: int) -> Iterator[Tensor]:
    """Copy windows row by row into batches (B, C, height, width) of at most ``size``."""
    rows, columns = grid.shape[:2]
    places = torch.arange(rows * columns, device=grid.device)
    for begin in range(0, len(places), size):
        chosen = places[begin : begin + size]
        yield grid[chosen // columns, chosen % columns]


def dense_grid(scores: Tensor) -> Tensor:
    """Bring a network's dense output for one input to (rows, columns, classes)."""
    return scores[0].reshape(scores.shape[1], -1, scores.shape[-1]).permute(1, 2, 0)
