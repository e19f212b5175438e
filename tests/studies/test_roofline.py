"""Matrix products against the textbook."""

import pytest
import torch
from torch import nn

from tex_lightning.inference.engine import count_macs
from tex_lightning.studies.timing import SHAPES, Timing, gemm_gflops, products


def test_macs_are_those_of_the_textbook():
    network = nn.Sequential(nn.Conv2d(3, 4, 3, padding=1), nn.BatchNorm2d(4), nn.Conv2d(4, 5, 1))
    x = torch.zeros(1, 3, 10, 12)
    assert count_macs(lambda: network.eval()(x)) == 10 * 12 * (4 * 3 * 9 + 5 * 4)


def test_the_rate_is_that_of_the_fastest_product():
    timings = {"10x20x30": Timing(2.0, 2.0, (2.0,)), "1000x1000x1000": Timing(10.0, 10.0, (10.0,))}
    assert gemm_gflops(timings) == pytest.approx(200.0)  # 2e9 operations in 10 ms
    functions = products(torch.device("cpu"))
    assert len(functions) == len(SHAPES)
    rows, _, columns = SHAPES[-1]
    assert functions["x".join(map(str, SHAPES[-1]))]().shape == (rows, columns)
