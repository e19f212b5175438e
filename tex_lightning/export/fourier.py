"""Power in bands of windowed frames by real matrix products, for files without Fourier transforms.

The transform of N = P Q samples is one of P samples, then one of Q for each of its outcomes (Cooley
and Tukey 1965): for 2,205 samples a fifteenth of the arithmetic of one product, a hundredth of the
constants in the file, and as near to the exact values as a fast Fourier transform.
"""

import math

import torch
from torch import Tensor, nn


class BandPower(nn.Module):
    """Weighted power of the Fourier channels of every frame, all axes together.

    Args:
        window: (samples,) that frames are multiplied by.
        hop: Samples from one frame to the next.
        filters: (bands, samples // 2 + 1) weights of the channels.
        centred: Whether every frame's mean is removed first.
    """

    window: Tensor
    first: Tensor
    second: Tensor
    weights: Tensor

    def __init__(self, window: Tensor, hop: int, filters: Tensor, *, centred: bool) -> None:
        super().__init__()
        self.hop, self.centred = hop, centred
        length = len(window)
        self.outer, self.inner = factors(length)
        kept = self.outer // 2 + 1  # the others are their conjugates
        self.register_buffer("window", window.clone())
        self.register_buffer("first", _first_stage(self.outer, kept))
        self.register_buffer("second", _second_stage(self.outer, self.inner, kept))
        channel = torch.arange(kept)[:, None] + self.outer * torch.arange(self.inner)
        mirrored = torch.minimum(channel, length - channel).flatten()
        once = torch.zeros(len(mirrored))
        once[_first_places(mirrored)] = 1
        self.register_buffer("weights", filters.float()[:, mirrored].T * once[:, None])

    def forward(self, trace: Tensor) -> Tensor:
        """Signal (axes, samples), at least a window long, to power (bands, frames)."""
        length = len(self.window)
        count = (trace.shape[-1] - length) // self.hop + 1
        axes = trace.shape[0]
        frames = self._frames(trace, count)
        if self.centred:
            frames = frames - frames.mean(dim=-1, keepdim=True)
        grid = (frames * self.window).reshape(axes * count, self.outer, self.inner)
        kept = len(self.second)
        # of every sample of the inner grid real and imaginary parts, each of the kept channels
        outer = (grid.transpose(1, 2) @ self.first).reshape(axes * count, self.inner, 2, kept)
        inner = outer.permute(3, 0, 2, 1).reshape(kept, axes * count, 2 * self.inner)
        squares = (inner @ self.second).square().reshape(kept, axes, count, 2, self.inner)
        power = squares.sum(dim=(1, 3)).permute(1, 0, 2).reshape(count, kept * self.inner)
        found: Tensor = (power @ self.weights).T
        return found

    def _frames(self, trace: Tensor, count: int) -> Tensor:
        """Frames (axes, count, samples), put together of blocks: one by one takes much longer."""
        length = len(self.window)
        block = math.gcd(length, self.hop)
        blocks = trace.shape[-1] // block
        cut = trace[:, : blocks * block].reshape(trace.shape[0], blocks, block)
        first = torch.arange(count)[:, None] * (self.hop // block)
        places = (first + torch.arange(length // block)).flatten()
        return cut.index_select(1, places).reshape(trace.shape[0], count, length)


def factors(length: int) -> tuple[int, int]:
    """P and Q with P Q = length for which both stages together take the fewest products."""
    pairs = [(each, length // each) for each in range(1, length + 1) if length % each == 0]
    return min(pairs, key=lambda pair: pair[0] + 2 * pair[1])


def _first_stage(outer: int, kept: int) -> Tensor:
    """(outer, 2 * kept): cosines, then sines of -2 pi p k / P."""
    angles = _angles(torch.arange(outer)[:, None] * torch.arange(kept), outer)
    return torch.cat((angles.cos(), angles.sin()), dim=1).float()


def _second_stage(outer: int, inner: int, kept: int) -> Tensor:
    """(kept, 2 * inner, 2 * inner): products by exp(-2 pi i q (k + P l) / N), for each k."""
    channel = torch.arange(kept)[:, None, None] + outer * torch.arange(inner)
    angles = _angles(torch.arange(inner)[:, None] * channel, outer * inner)
    real, imaginary = angles.cos(), angles.sin()
    rows = torch.cat((real, imaginary), dim=2), torch.cat((-imaginary, real), dim=2)
    return torch.cat(rows, dim=1).float()


def _angles(turns: Tensor, length: int) -> Tensor:
    """-2 pi turns / length, float64; whole turns are taken off first."""
    return (turns % length).double() * (-2 * math.pi / length)


def _first_places(values: Tensor) -> list[int]:
    """Where each value occurs first."""
    places: dict[int, int] = {}
    for place, value in enumerate(values.tolist()):
        places.setdefault(value, place)
    return list(places.values())
