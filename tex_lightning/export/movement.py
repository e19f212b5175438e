"""Find the start of steady movement in a signal whose length is known only at run time."""

from typing import Any

import torch
from torch import Tensor
from torch.nn.functional import pad

from tex_lightning.features.spectrogram import (
    IMPACT_FACTOR,
    KNOWN_SECONDS,
    QUIET_SECONDS,
    SEARCH_SECONDS,
    SETTLING_SECONDS,
    STEADY_FACTOR,
)


def traced_start(trace: Tensor, sampling_rate: float) -> Tensor:
    """:func:`~tex_lightning.features.spectrogram.movement_start` as one graph for any length.

    The beginning is filled up with zeros to the time after which nothing changes the start, and
    a touch that would need the zeros does not count.

    Args:
        trace: (axes, samples).
        sampling_rate: Sampling rate in Hz.

    Returns:
        int64 ().
    """
    quiet, settling, search, known = (
        int(seconds * sampling_rate)
        for seconds in (QUIET_SECONDS, SETTLING_SECONDS, SEARCH_SECONDS, KNOWN_SECONDS)
    )
    head = pad(trace, (0, known))[:, :known]
    middle = (quiet - 1) // 2  # PyTorch's median is the lower one
    offset = head[:, :quiet].sort(dim=-1).values[:, middle : middle + 1]
    strength = (head - offset).square().sum(dim=0).sqrt()
    level = strength[:quiet].mean()
    after = strength[quiet + settling :].double().cumsum(0)
    steady = after[quiet:] - after[:-quiet] > STEADY_FACTOR * level * quiet
    burst = strength[quiet:search] > IMPACT_FACTOR * level
    count = min(len(steady), len(burst))
    complete = torch.arange(count, device=trace.device) < trace.shape[-1] - 2 * quiet - settling
    touches = burst[:count] & steady[:count] & complete
    first = touches.long().argmax() + quiet + settling
    return torch.where(touches.any(), first, 0)


def promise(condition: Any) -> None:  # noqa: ANN401
    """Tell the tracer a fact about sizes; a program of torch.export checks it when it runs."""
    torch._check(condition)  # type: ignore[no-untyped-call]


def movement(trace: Tensor, start: Tensor, least: int) -> Tensor:
    """The samples (axes, samples) from ``start`` on; at least ``least`` are promised."""
    begin: Any = start.item()
    promise(begin >= 0)
    promise(begin <= trace.shape[-1] - least)
    return trace[:, begin:]
