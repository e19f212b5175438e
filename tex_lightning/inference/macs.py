"""Multiply-accumulates, counted by PyTorch."""

from collections.abc import Callable

import torch
from torch.utils.flop_counter import FlopCounterMode


def count_macs(function: Callable[[], object]) -> int:
    """Multiply-accumulates of the convolutions and matrix products that a function runs.

    PyTorch counts two operations for each; normalisation, pooling and Fourier transforms are not
    counted.
    """
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        function()
    return int(counter.get_total_flops()) // 2
