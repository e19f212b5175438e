"""DFT321 of a movement whose length is known only when the file runs."""

from functools import cache

import torch
from torch import Tensor

from tex_lightning.export.movement import promise
from tex_lightning.features.dft321 import quick_length

LONGEST = 2**24  # samples, of which the first are taken: 28 minutes at 10 kHz
AXES = 3


def joined_axes(trace: Tensor, least: int) -> Tensor:
    """:func:`~tex_lightning.features.dft321.dft321` of three axes; one axis stays as it is.

    Transforms are of float64: ONNX Runtime's of any length (Bluestein 1970) lose half the digits.

    Args:
        trace: (axes, samples), without means.
        least: Smallest promised value of :func:`quick_length` of these samples.

    Returns:
        (1, samples); of three axes as many as :func:`quick_length` says.
    """
    three = torch.scalar_tensor(trace.shape[0], dtype=torch.int64) == AXES
    samples = torch.scalar_tensor(trace.shape[1], dtype=torch.int64)
    lengths = torch.tensor(quick_lengths())
    quick = torch.where(lengths <= samples, lengths, 1).max()
    reduced = _reduced(trace[:, : _size(torch.where(three, quick, 1), trace, 1)])
    kept = _size(torch.where(three, quick, samples), trace, least)
    every = torch.cat((reduced, trace[0]))  # one axis has one sample of the first
    found: Tensor = every.index_select(0, torch.where(three, 0, 1) + torch.arange(kept))
    return found[None]


def _size(count: Tensor, trace: Tensor, least: int) -> int:
    size: int = count.item()  # type: ignore[assignment]
    promise(size >= least)
    promise(size <= trace.shape[1])
    return size


def _reduced(trace: Tensor) -> Tensor:
    centred = (trace - trace.mean(dim=-1, keepdim=True)).double()
    spectra = torch.view_as_real(torch.fft.fft(centred))  # (axes, samples, 2)
    magnitude = spectra.square().sum(dim=(0, 2)).sqrt()
    total = spectra.sum(dim=0)
    length = total.square().sum(dim=1).sqrt()
    one = torch.tensor([1.0, 0.0], dtype=total.dtype)  # where axes cancel any phase serves
    phase = torch.where(length[:, None] > 0, total / length[:, None], one)
    product = torch.view_as_complex(magnitude[:, None] * phase)
    return torch.view_as_real(torch.fft.ifft(product))[:, 0].float()


@cache
def quick_lengths() -> list[int]:
    """All results of :func:`quick_length`, up to the longest."""
    found, length = [], LONGEST
    while length >= 1:
        found.append(quick_length(length))
        length = found[-1] - 1
    return found[::-1]
