"""Layers that take their input a few columns at a time and settle what cannot change any more."""

from collections.abc import Callable, Iterable
from typing import Protocol

import torch
from torch import Tensor, nn
from torch.nn import functional

from tex_lightning.inference.engine import FastResponseNorm
from tex_lightning.networks.blocks import is_plain

Columns = Tensor | None


class Linear:
    """A convolution of single positions, as the matrix product that it is."""

    def __init__(self, conv: nn.Conv2d) -> None:
        _check_plain(conv)
        self.weight = conv.weight.detach().flatten(1)
        self.bias = None if conv.bias is None else conv.bias.detach()
        self.macs = 0

    def __call__(self, columns: Tensor) -> Tensor:
        """Weigh the channels."""
        self.macs += columns.shape[0] * columns.shape[1] * self.weight.numel()
        return functional.linear(columns, self.weight, self.bias)


class StreamingConv:
    """A convolution of stride 1 that multiplies a settled column with its weights once.

    A column is multiplied with all the taps that it will meet, and an output is the sum of what the
    columns under it give to their places. These products are kept of the columns that later outputs
    reach back to. Open columns meet only the taps that matter at the edge.

    Args:
        conv: The convolution; its second kernel axis is time.
    """

    def __init__(self, conv: nn.Conv2d) -> None:
        (self.rows, self.taps), (self.row_padding, self.padding) = _geometry(conv)
        self.outputs = conv.out_channels
        self.places = self.taps * self.outputs
        # (rows x inputs, taps x outputs)
        weight = conv.weight.detach().permute(2, 1, 3, 0)
        self.weight = weight.flatten(2).flatten(0, 1).contiguous()
        bias = weight.new_zeros(self.taps, self.outputs)
        if conv.bias is not None:
            bias[self.padding] = conv.bias.detach()  # with the tap that no output lacks
        self.bias = bias.flatten()
        self.restart()

    def restart(self) -> None:
        """Drop the products."""
        self.macs = 0
        self.kept: Tensor | None = None  # (columns, bands, taps x outputs), fewer than taps

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Multiply the columns, and sum up what lies under every output."""
        if columns is None:
            return None, 0
        x = self._stacked(columns)
        number, bands, _ = x.shape
        if self.kept is None:
            self.kept = x.new_zeros(self.padding, bands, self.places)
        known = self.kept.shape[0]
        products = x.new_empty(known + number + self.padding, bands, self.places)
        products[:known] = self.kept
        if self.padding:
            products[known + number :] = 0
        self._multiply(x, settled, products[known : known + number])
        done = max(0, known + settled - self.taps + 1)
        if settled:
            self.kept = products[done : known + settled].clone()
        return self._summed(products), done

    def _stacked(self, columns: Tensor) -> Tensor:
        """Every position with the rows around it: (count, bands, rows x inputs)."""
        if self.row_padding:
            columns = functional.pad(columns, (0, 0, self.row_padding, self.row_padding))
        count, bands, inputs = columns.shape
        size = (count, bands - self.rows + 1, self.rows * inputs)
        return columns.contiguous().as_strided(size, (bands * inputs, inputs, 1))

    def _multiply(self, x: Tensor, settled: int, products: Tensor) -> None:
        """Fill in the products (columns, bands, taps x outputs), of open columns what matters."""
        number = x.shape[0]
        near = min(self.taps, number - settled + self.padding)  # last taps, which open columns meet
        # one product for all where the open columns need most of the taps anyway
        together = number if settled and self.taps - near < 2 else settled
        if together:
            self._multiply_all(x[:together], products[:together], 0)
        if together < number:
            self._multiply_all(x[together:], products[together:], self.taps - near)

    def _multiply_all(self, x: Tensor, products: Tensor, first: int) -> None:
        """With the taps from ``first`` on."""
        skipped = first * self.outputs
        weight = self.weight[:, skipped:]
        self.macs += x.shape[0] * x.shape[1] * weight.numel()
        found = products.flatten(0, 1)[:, skipped:]
        torch.addmm(self.bias[skipped:], x.flatten(0, 1), weight, out=found)

    def _summed(self, products: Tensor) -> Columns:
        """Outputs (count, bands, outputs): column ``c + t`` gives tap ``t`` to output ``c``."""
        count, bands = products.shape[0] - self.taps + 1, products.shape[1]
        if count <= 0:
            return None
        column, band, _ = products.stride()
        size, strides = (
            (count, bands, self.taps, self.outputs),
            (column, band, column + self.outputs, 1),
        )
        return products.as_strided(size, strides).sum(dim=2)


class GatheringConv:
    """A convolution of stride 1 and few inputs: what it sees of a position lies side by side.

    Args:
        conv: The convolution; its second kernel axis is time.
    """

    def __init__(self, conv: nn.Conv2d) -> None:
        (self.rows, self.taps), (self.row_padding, self.padding) = _geometry(conv)
        # (taps x rows x inputs, outputs)
        self.weight = conv.weight.detach().permute(3, 2, 1, 0).flatten(0, 2).contiguous()
        self.bias = self.weight.new_zeros(()) if conv.bias is None else conv.bias.detach()
        self.restart()

    def restart(self) -> None:
        """Drop the last columns."""
        self.macs = 0
        self.kept: Tensor | None = None  # (columns, bands, inputs) with padding, fewer than taps

    def push(self, columns: Columns, settled: int) -> tuple[Columns, int]:
        """Multiply what lies under every output."""
        if columns is None:
            return None, 0
        columns = functional.pad(columns, (0, 0, self.row_padding, self.row_padding))
        _, bands, inputs = columns.shape
        beyond = columns.new_zeros(self.padding, bands, inputs)
        kept = beyond if self.kept is None else self.kept
        known = kept.shape[0]
        x = torch.cat((kept, columns, beyond))
        done = max(0, known + settled - self.taps + 1)
        self.kept = x[done : known + settled].clone()
        count, places = x.shape[0] - self.taps + 1, bands - self.rows + 1
        if count <= 0:
            return None, 0
        size = (count, places, self.taps, self.rows * inputs)
        seen = x.as_strided(size, (bands * inputs, inputs, bands * inputs, 1))
        self.macs += count * places * self.weight.numel()
        outputs = torch.addmm(self.bias, seen.reshape(count * places, -1), self.weight)
        return outputs.view(count, places, -1), done


def _check_plain(conv: nn.Conv2d) -> None:
    if not is_plain(conv) or conv.groups > 1:
        raise ValueError(f"{conv} has a stride, a dilation or groups")


def _geometry(conv: nn.Conv2d) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Kernel and padding along bands and time."""
    _check_plain(conv)
    assert not isinstance(conv.padding, str)
    return conv.kernel_size, conv.padding


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
