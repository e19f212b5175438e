"""The choice of a device, and of how exactly it computes."""

import pytest
import torch

import tex_lightning as tl
from tex_lightning import devices
from tex_lightning.config import CONF
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.errors import UserError


@pytest.fixture
def flags():
    """PyTorch's own flags, which are put back."""
    backends = torch.backends.cudnn, torch.backends.cuda.matmul
    before = [backend.allow_tf32 for backend in backends]
    yield lambda: [backend.allow_tf32 for backend in backends]
    for backend, value in zip(backends, before, strict=True):
        backend.allow_tf32 = value


def test_a_command_uses_tf32_where_it_is_asked_to(cli, flags, tmp_path):
    torch.backends.cudnn.allow_tf32 = torch.backends.cuda.matmul.allow_tf32 = False
    cli("task=predict", "checkpoint=none.ckpt", f"hydra.run.dir={tmp_path}", "trainer.tf32=true")
    assert flags() == [True, True]


def test_a_loaded_network_is_exact_unless_it_is_told_otherwise(flags, untrained):
    torch.backends.cudnn.allow_tf32 = True
    tl.load(untrained / "checkpoints" / "haptic.ckpt")
    assert flags() == [False, False]
    tl.load(untrained / "checkpoints" / "haptic.ckpt", "trainer.tf32=true")
    assert flags() == [True, True]


def test_float64_is_refused_where_there_is_none(monkeypatch):
    trainer = read_config(compose_config(CONF, ["trainer.precision=64-true"])).trainer
    devices.check_precision(trainer)
    monkeypatch.setattr(devices, "pick_device", lambda _: torch.device("mps"))
    with pytest.raises(UserError, match="Apple's GPUs have no float64"):
        devices.check_precision(trainer)
