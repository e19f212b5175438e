import os
from collections.abc import Iterator
from multiprocessing import get_start_method, set_start_method
from pathlib import Path

import pytest
import torch
from conftest import make_card

from tex_lightning.config import EngineConfig
from tex_lightning.studies.memory import forward_peak_mib

ENGINE = EngineConfig(
    fold_batch_norm=True,
    fast_response_norm=True,
    channels_last=False,
    precision="fp32",
    tile=None,
)


@pytest.fixture
def job_of_joblib() -> Iterator[None]:
    """Processes start as in a job of a sweep that joblib runs, whose way no other process knows."""
    from joblib.externals.loky.backend import context  # noqa: F401  (registers its way)

    before = get_start_method(allow_none=True)
    set_start_method("loky", force=True)
    yield
    assert get_start_method() == "loky"
    set_start_method(before, force=True)


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="Linux only")
@pytest.mark.usefixtures("job_of_joblib")
def test_the_peak_holds_the_largest_map_and_not_much_more():
    card = make_card("haptic", width=1.0, norm="none")
    frames = 6000
    before = dict(os.environ)
    peak = forward_peak_mib(card, ENGINE, (1, 1, 50, frames), torch.device("cpu"))
    assert dict(os.environ) == before
    first_map = 50 * 50 * frames * 4 / 2**20  # 50 channels of 50 bands
    assert first_map < peak < 3 * first_map
