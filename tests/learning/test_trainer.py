"""Checkpoint files: what Lightning would write, and never a part of it."""

from pathlib import Path

import pytest
import torch
from lightning.fabric.plugins import TorchCheckpointIO

from tex_lightning.errors import UserError
from tex_lightning.learning.trainer import CheckpointFiles


class Unsaveable:
    """What breaks the writing of a file off."""

    def __reduce__(self) -> str:
        raise OSError(28, "no space left on device")


def test_a_checkpoint_is_the_one_that_lightning_would_write(tmp_path: Path) -> None:
    checkpoint = {"epoch": 3, "state_dict": {"weight": torch.arange(5.0)}}
    CheckpointFiles().save_checkpoint(checkpoint, tmp_path / "new" / "here.ckpt")
    TorchCheckpointIO().save_checkpoint(checkpoint, tmp_path / "lightning.ckpt")
    ours, theirs = (
        torch.load(path, weights_only=True)
        for path in (tmp_path / "new" / "here.ckpt", tmp_path / "lightning.ckpt")
    )
    assert ours["epoch"] == theirs["epoch"] == 3
    assert torch.equal(ours["state_dict"]["weight"], theirs["state_dict"]["weight"])


def test_a_write_that_fails_leaves_the_earlier_checkpoint_whole(tmp_path: Path) -> None:
    path = tmp_path / "last.ckpt"
    CheckpointFiles().save_checkpoint({"epoch": 1}, path)
    with pytest.raises(UserError, match="Cannot write"):
        CheckpointFiles().save_checkpoint({"weight": torch.ones(1000), "x": Unsaveable()}, path)
    assert torch.load(path, weights_only=True) == {"epoch": 1}
    assert [*tmp_path.iterdir()] == [path]
