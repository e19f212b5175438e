"""Layers that take their input a few columns at a time and settle what cannot change any more."""

from collections.abc import Callable, Iterable

import torch
from torch import Tensor, nn
from torch.nn import functional

from tex_lightning.networks.blocks import is_plain

Columns = Tensor | None  # (columns, bands, channels)


class StreamingLayer:
    """The base of every layer of a stream.

    Attributes:
        macs: Multiply-accumulates since the restart.
        kept: What later outputs need of settled columns.
    """

    macs = 0
    kept: Columns = None

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Take the next columns and give those of the output.

        Args:
            columns: They follow the ones that were settled in earlier calls.
            settled: The first so many of them will not change.

        Returns:
            The output columns that follow the ones settled in earlier calls, as they are if the
            input ends here, and how many of them are settled.
        """
        raise NotImplementedError

    def restart(self) -> None:
        """Forget all input."""
        self.macs, self.kept = 0, None


class StreamingConv(StreamingLayer):
    """A convolution of stride 1 that multiplies a settled column with its weights once.

    A column is multiplied with all the taps that it will meet, and an output is the sum of what the
    columns under it give to their places. The products are kept of the columns that later outputs
    reach back to. Open columns meet only the taps that matter at the edge.

    Args:
        conv: The convolution; its second kernel axis is time.
    """

    def __init__(self, conv: nn.Conv2d) -> None:
        if not is_plain(conv) or conv.groups > 1 or isinstance(conv.padding, str):
            raise ValueError(f"{conv} has a stride, a dilation or groups")
        (self.rows, self.taps), (self.row_padding, self.padding) = conv.kernel_size, conv.padding
        self.outputs = conv.out_channels
        # (rows x inputs, taps x outputs)
        weight = conv.weight.detach().permute(2, 1, 3, 0)
        self.weight = weight.flatten(2).flatten(0, 1).contiguous()
        bias = weight.new_zeros(self.taps, self.outputs)
        if conv.bias is not None:
            bias[self.padding] = conv.bias.detach()  # with the tap that no output lacks
        self.bias = bias.flatten()

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Multiply the columns, and sum up what lies under every output."""
        if columns is None:
            return None, 0
        x = self._stacked(columns)
        number, bands, _ = x.shape
        size = (bands, self.taps * self.outputs)
        kept = x.new_zeros(self.padding, *size) if self.kept is None else self.kept
        products = torch.cat((kept, x.new_zeros(number + self.padding, *size)))
        near = min(self.taps, number - settled + self.padding)  # last taps, which open ones meet
        # one product for all where the open columns need most of the taps anyway
        fully = number if settled and near >= self.taps - 1 else settled
        self._multiply(x[:fully], products[len(kept) :], 0)
        self._multiply(x[fully:], products[len(kept) + fully :], self.taps - near)
        done = max(0, len(kept) + settled - self.taps + 1)
        if settled or self.kept is None:
            self.kept = products[done : len(kept) + settled].clone()
        count = len(products) - self.taps + 1
        if count <= 0:
            return None, 0
        # column c + t gives tap t to output c
        column, band, _ = products.stride()
        summands = (count, bands, self.taps, self.outputs)
        strides = (column, band, column + self.outputs, 1)
        return products.as_strided(summands, strides).sum(dim=2), done

    def _stacked(self, columns: Tensor) -> Tensor:
        """Every position with the rows around it: (count, bands, rows x inputs)."""
        columns = functional.pad(columns, (0, 0, self.row_padding, self.row_padding)).contiguous()
        count, bands, inputs = columns.shape
        size = (count, bands - self.rows + 1, self.rows * inputs)
        return columns.as_strided(size, (bands * inputs, inputs, 1))

    def _multiply(self, x: Tensor, products: Tensor, first: int) -> None:
        """Fill in the products (columns, bands, taps x outputs) with the taps from ``first`` on."""
        if not len(x):
            return
        skipped = first * self.outputs
        weight = self.weight[:, skipped:]
        self.macs += x.shape[0] * x.shape[1] * weight.numel()
        found = products[: len(x)].flatten(0, 1)[:, skipped:]
        torch.addmm(self.bias[skipped:], x.flatten(0, 1), weight, out=found)


class StreamingPool(StreamingLayer):
    """Max pooling by 2x2 that pools what is left at the edge.

    Args:
        pool: Kernel and stride 2, no padding, ceil mode.
    """

    def __init__(self, pool: nn.MaxPool2d) -> None:
        if (pool.kernel_size, pool.stride, pool.padding, pool.ceil_mode) != (2, 2, 0, True):
            raise ValueError(f"{pool} is not by 2x2 in ceil mode")

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Pool pairs of columns, and keep a settled one that waits for the other."""
        if columns is None:
            return None, 0
        if self.kept is not None:
            columns, settled = torch.cat((self.kept, columns)), settled + 1
        self.kept = columns[settled - 1 : settled].clone() if settled % 2 else None
        # maxima of slices, as PyTorch's pooling takes several times as long for a few columns
        return _larger(_larger(columns).transpose(0, 1)).transpose(0, 1).contiguous(), settled // 2


class Pointwise(StreamingLayer):
    """A function that treats every position by itself."""

    def __init__(self, function: Callable[[Tensor], Tensor]) -> None:
        self.function = function

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Apply the function."""
        return None if columns is None else self.function(columns), settled


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
            layers.append(StreamingConv(module))
        elif isinstance(module, nn.MaxPool2d):
            layers.append(StreamingPool(module))
        elif isinstance(module, nn.ReLU):
            layers.append(Pointwise(torch.relu_))
        elif not isinstance(module, nn.Identity | nn.Dropout):
            layers.append(Pointwise(_channels_first(module)))
    return layers


def _channels_first(module: nn.Module) -> Callable[[Tensor], Tensor]:
    """Give a module of images (1, channels, count, bands) what is shaped as columns."""
    return lambda columns: module(columns.permute(2, 0, 1)[None])[0].permute(1, 2, 0).contiguous()


def _larger(x: Tensor) -> Tensor:
    """The larger of two neighbours along the first axis; an odd one out stays as it is."""
    count = len(x)
    if count == 1:
        return x
    larger = torch.maximum(x[:-1:2], x[1::2])
    return torch.cat((larger, x[-1:])) if count % 2 else larger
