"""Layers of a convolutional network that take their input a few columns at a time.

Columns come in the order of time. The last ones may still change: zero padding and incomplete
pooling windows make them depend on where the input ends. So every layer is given the columns beyond
those settled before, with the number of them that are settled now, and gives back its own. Settled
columns are computed once; from the open ones nothing is kept.

Convention: columns are (count, bands, channels); None stands for no columns.
"""

from collections.abc import Callable, Iterable
from typing import Protocol

import torch
from torch import Tensor, nn

from tex_lightning.inference.engine import FastResponseNorm
from tex_lightning.inference.streaming.convolutions import (
    Columns,
    GatheringConv,
    Linear,
    StreamingConv,
)


class StreamingLayer(Protocol):
    """The interface of every layer of a stream.

    Attributes:
        macs: Multiply-accumulates since the restart.
    """

    @property
    def macs(self) -> int: ...  # noqa: D102  (see above)

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Take the next columns and give those of the output.

        Args:
            columns: They follow the ones that were settled in earlier calls.
            settled: The first so many of them will not change.

        Returns:
            The output columns that follow the ones settled in earlier calls, as they are if the
            input ends here, and how many of them are settled.
        """

    def restart(self) -> None:
        """Forget all input."""


def streaming_layers(modules: Iterable[nn.Module]) -> list[StreamingLayer]:
    """Return the streaming counterparts of a network's modules, with copies of their weights.

    Containers are entered. What is neither a convolution nor a max pooling is taken to treat every
    position by itself, as ReLU does, and normalisation in evaluation mode.
    """
    layers: list[StreamingLayer] = []
    for module in modules:
        if isinstance(module, nn.Sequential):
            layers += streaming_layers(module)
        elif isinstance(module, nn.Conv2d):
            layers.append(_streaming_conv(module))
        elif isinstance(module, nn.MaxPool2d):
            layers.append(StreamingPool(module))
        elif isinstance(module, nn.ReLU):
            layers.append(Pointwise(torch.relu_))
        elif isinstance(module, FastResponseNorm):
            layers.append(Pointwise(ResponseNorm(module)))
        elif not isinstance(module, nn.Identity | nn.Dropout):
            layers.append(Pointwise(_channels_first(module)))
    return layers


def _streaming_conv(conv: nn.Conv2d) -> StreamingLayer:
    if conv.kernel_size == (1, 1):
        return Pointwise(Linear(conv))
    # whichever has less to copy
    gather = conv.kernel_size[0] * conv.in_channels < conv.out_channels
    return GatheringConv(conv) if gather else StreamingConv(conv)


class Pointwise:
    """A function that treats every position by itself."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self.function = function

    @property
    def macs(self) -> int:
        """Multiply-accumulates of a linear function; other functions have none."""
        return self.function.macs if isinstance(self.function, Linear) else 0

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Apply the function."""
        return None if columns is None else self.function(columns), settled

    def restart(self) -> None:
        """Nothing was kept but the count."""
        if isinstance(self.function, Linear):
            self.function.macs = 0


class ResponseNorm:
    """:class:`FastResponseNorm` for few positions, where the number of calls is what counts.

    Args:
        layer: Gives the constants.
    """

    def __init__(self, layer: FastResponseNorm) -> None:
        self.scale, self.k = layer.scale, torch.tensor(layer.k)
        self.neighbours: Tensor | None = None  # (channels, channels)

    def __call__(self, columns: Tensor) -> Tensor:
        """Normalise; one product sums the squares of the 5 channels around each."""
        x = columns.flatten(0, 1)
        if self.neighbours is None:
            self.neighbours = x.new_full((x.shape[1],) * 2, self.scale).triu(-2).tril(2)
            self.k = self.k.to(x)
        factor = torch.addmm(self.k, x.square(), self.neighbours).rsqrt_()
        return (x * factor).mul_(factor.sqrt_()).view(columns.shape)


class StreamingPool:
    """Max pooling by 2x2 that pools what is left at the edge.

    Args:
        pool: Kernel and stride 2, no padding, ceil mode.
    """

    def __init__(self, pool: nn.MaxPool2d) -> None:
        if (pool.kernel_size, pool.stride, pool.padding, pool.ceil_mode) != (2, 2, 0, True):
            raise ValueError(f"{pool} is not by 2x2 in ceil mode")
        self.macs = 0
        self.restart()

    def restart(self) -> None:
        """Drop the incomplete window."""
        self.rest: Columns = None

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Pool pairs of columns, and keep a settled one that waits for the other."""
        if columns is None:
            return None, 0
        if self.rest is not None:
            columns, settled = torch.cat((self.rest, columns)), settled + 1
        self.rest = columns[settled - 1 : settled].clone() if settled % 2 else None
        return _pooled(columns), settled // 2


def _channels_first(module: nn.Module) -> Callable[[Tensor], Tensor]:
    """Give a module of images (1, channels, count, bands) what is shaped as columns."""
    return lambda columns: module(columns.permute(2, 0, 1)[None])[0].permute(1, 2, 0)


def _pooled(x: Tensor) -> Tensor:
    """The larger of two neighbours along both axes; an odd one out stays as it is.

    Slices and maxima, as PyTorch's pooling takes several times as long for a few columns.
    """
    count, bands, _ = x.shape
    if count > 1:
        larger = torch.maximum(x[:-1:2], x[1::2])
        x = torch.cat((larger, x[-1:])) if count % 2 else larger
    if bands > 1:
        larger = torch.maximum(x[:, :-1:2], x[:, 1::2])
        x = torch.cat((larger, x[:, -1:]), dim=1) if bands % 2 else larger
    return x
