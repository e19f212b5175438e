"""Layers of a convolutional network that take their input a few columns at a time.

Columns come in the order of time. The last ones may still change: zero padding and incomplete
pooling windows make them depend on where the input ends. So every layer is given the columns beyond
those settled before, with the number of them that are settled now, and gives back its own. Settled
columns are computed once; from the open ones nothing is kept.

Convention: columns are (1, channels, count, bands), time before bands, with the channels innermost
in memory; None stands for no columns.
"""

from collections.abc import Callable, Iterable
from typing import Protocol

import torch
from torch import Tensor, nn
from torch.nn import functional

Columns = Tensor | None


class StreamingLayer(Protocol):
    """What every layer of a stream can do.

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
            single = module.kernel_size == (1, 1)
            layers.append(Pointwise(Linear(module)) if single else StreamingConv(module))
        elif isinstance(module, nn.MaxPool2d):
            layers.append(StreamingPool(module))
        elif not isinstance(module, nn.Identity | nn.Dropout):
            layers.append(Pointwise(module))
    return layers


class Pointwise:
    """A function that treats every position by itself."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self.function = function

    @property
    def macs(self) -> int:
        """Of a linear function; others multiply nothing."""
        return self.function.macs if isinstance(self.function, Linear) else 0

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Apply the function."""
        return None if columns is None else self.function(columns), settled

    def restart(self) -> None:
        """Nothing was kept but the count."""
        if isinstance(self.function, Linear):
            self.function.macs = 0


class Linear:
    """A convolution of single positions, as the matrix product that it is."""

    def __init__(self, conv: nn.Conv2d) -> None:
        _check_plain(conv)
        self.weight = conv.weight.detach().flatten(1)
        self.bias = None if conv.bias is None else conv.bias.detach()

        self.macs = 0

    def __call__(self, columns: Tensor) -> Tensor:
        """Weigh the channels."""
        self.macs += columns.shape[2] * columns.shape[3] * self.weight.numel()
        x = functional.linear(columns.permute(0, 2, 3, 1), self.weight, self.bias)
        return x.permute(0, 3, 1, 2)


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
            columns, settled = torch.cat((self.rest, columns), dim=2), settled + 1
        waits = settled % 2 == 1
        self.rest = columns[:, :, settled - 1 : settled].clone() if waits else None
        return _pooled(columns), settled // 2


class StreamingConv:
    """A convolution of stride 1 that adds each input column to the outputs it takes part in.

    The outputs that need more input are kept as partial sums, to which open columns add the few
    taps that matter at the edge, and no column is multiplied with a tap twice.

    Args:
        conv: The convolution; its second kernel axis is time.
    """

    def __init__(self, conv: nn.Conv2d) -> None:
        _check_plain(conv)
        self.rows, self.taps = conv.kernel_size
        assert not isinstance(conv.padding, str)
        self.row_padding, self.padding = conv.padding
        self.outputs = conv.out_channels
        # An input meets the last tap in the first output it takes part in, so the taps are turned
        # round: (rows x inputs, places x outputs)
        weight = conv.weight.detach().flip(3)
        self.weight = weight.permute(2, 1, 3, 0).flatten(2).flatten(0, 1).contiguous()
        bias = weight.new_zeros(self.taps, self.outputs)
        if conv.bias is not None:
            # with the place that no output lacks: that of the input beside it
            bias[self.taps - 1 - self.padding] = conv.bias.detach()
        self.bias = bias.flatten()
        self.restart()

    def restart(self) -> None:
        """Drop the partial sums."""
        self.macs = 0
        self.sums: Tensor | None = None  # (taps - 1, bands, outputs): of the next outputs
        self.early = self.taps - 1 - self.padding  # next outputs that begin before the input

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Add the columns to the outputs."""
        if columns is None:
            return None, 0
        number = columns.shape[2]
        count = number + self.padding
        near = min(self.taps, count - settled)  # places that are asked for of open columns
        # one product for all where the open columns need most of the places anyway
        together = number if settled and self.taps - near < 2 else settled
        x = self._stacked(columns)
        sums = self._next_sums(max(count, settled + self.taps - 1), x.shape[1])
        if together:
            products = self._products(x[:together], self.taps)
            _add(sums, products[:settled])
            self.sums = sums[settled : settled + self.taps - 1].clone()
            _add(sums[settled:], products[settled:])
        if together < number:
            _add(sums[settled:], self._products(x[settled:], near))
        early, self.early = self.early, max(0, self.early - settled)
        outputs = sums[early:count]
        if not len(outputs):
            return None, 0
        return outputs.permute(2, 0, 1)[None], max(0, settled - early)

    def _stacked(self, columns: Tensor) -> Tensor:
        """Every position with the rows around it: (count, bands, rows x inputs)."""
        x = columns[0].permute(1, 2, 0)
        if self.row_padding:
            count, bands, inputs = x.shape
            inner = x
            x = x.new_zeros(count, bands + 2 * self.row_padding, inputs)
            x[:, self.row_padding : self.row_padding + bands] = inner
        return x.unfold(1, self.rows, 1).transpose(2, 3).flatten(2)

    def _products(self, x: Tensor, places: int) -> Tensor:
        """What columns add to the outputs from their first on: (count, places, bands, outputs)."""
        size = places * self.outputs
        self.macs += x.numel() * size
        products = torch.addmm(self.bias[:size], x.flatten(0, 1), self.weight[:, :size])
        return products.view(*x.shape[:2], places, self.outputs).transpose(1, 2)

    def _next_sums(self, count: int, bands: int) -> Tensor:
        sums = self.weight.new_zeros(count, bands, self.outputs)
        if self.sums is not None:
            known = min(count, self.taps - 1)
            sums[:known] = self.sums[:known]
        return sums


def _add(sums: Tensor, products: Tensor) -> None:
    """Add (columns, places, ...) to (outputs, ...): column c's place p to output c + p."""
    columns, places = products.shape[:2]
    if columns < places:
        for column, product in enumerate(products):
            target = sums[column : column + places]
            target += product[: len(target)]
    else:
        for place in range(places):
            target = sums[place : place + columns]
            target += products[: len(target), place]


def _pooled(columns: Tensor) -> Tensor:
    """The larger of two neighbours along both axes; an odd one out stays as it is.

    Slices and maxima, as PyTorch's pooling takes several times as long for a few columns.
    """
    x = columns[0].permute(1, 2, 0)
    if len(x) > 1:
        larger = torch.maximum(x[:-1:2], x[1::2])
        x = torch.cat((larger, x[-1:])) if len(x) % 2 else larger
    if x.shape[1] > 1:
        larger = torch.maximum(x[:, :-1:2], x[:, 1::2])
        x = torch.cat((larger, x[:, -1:]), dim=1) if x.shape[1] % 2 else larger
    return x.permute(2, 0, 1)[None]


def _check_plain(conv: nn.Conv2d) -> None:
    if (conv.stride, conv.dilation, conv.groups) != ((1, 1), (1, 1), 1):
        raise ValueError(f"{conv} has a stride, a dilation or groups")
