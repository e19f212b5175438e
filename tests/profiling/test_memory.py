import os
from pathlib import Path

import pytest
import torch
from conftest import make_card

from tex_lightning.config import EngineConfig
from tex_lightning.profiling.memory import forward_peak_mib

ENGINE = EngineConfig(
    fold_batch_norm=True,
    fast_response_norm=True,
    channels_last=False,
    precision="fp32",
    compile=False,
    tile=None,
)


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="Linux only")
def test_the_peak_holds_the_largest_map_and_not_much_more():
    card = make_card("haptic", width=1.0, norm="none")
    frames = 6000
    before = dict(os.environ)
    peak = forward_peak_mib(card, ENGINE, (1, 1, 50, frames), torch.device("cpu"))
    assert dict(os.environ) == before
    first_map = 50 * 50 * frames * 4 / 2**20  # 50 channels of 50 bands
    assert first_map < peak < 3 * first_map
