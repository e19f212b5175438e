"""Convolutions of stride 1 that take their input a few columns at a time; see :mod:`.layers`."""

import torch
from torch import Tensor, nn
from torch.nn import functional

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
