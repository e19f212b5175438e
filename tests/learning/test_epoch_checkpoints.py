"""Checkpoints of epochs: written whole, of what can be read again, with finite weights."""

from pathlib import Path

import numpy as np
import pytest
import torch

from tex_lightning.errors import UserError
from tex_lightning.learning.epoch_checkpoints import CheckpointFiles, take_best


class Unsaveable:
    """What breaks the writing of a file off."""

    def __reduce__(self) -> str:
        raise OSError(28, "no space left on device")


def test_a_write_that_fails_leaves_the_earlier_checkpoint_whole(tmp_path: Path) -> None:
    path = tmp_path / "last.ckpt"
    CheckpointFiles().save_checkpoint({"epoch": 1}, path)
    with pytest.raises(UserError, match="Cannot write"):
        CheckpointFiles().save_checkpoint({"weight": torch.ones(1000), "x": Unsaveable()}, path)
    assert torch.load(path, weights_only=True) == {"epoch": 1}
    assert [*tmp_path.iterdir()] == [path]


@pytest.mark.parametrize("state", [{"best": np.float64(1)}, {"act": lambda: 1}, {"at": Path()}])
def test_a_state_that_no_checkpoint_gives_back_ends_the_first_epoch(tmp_path, state):
    path = tmp_path / "last.ckpt"
    with pytest.raises(UserError, match=r"^The state_dict of the callback Diary is not"):
        CheckpointFiles().save_checkpoint({"callbacks": {"Diary": state}}, path)
    CheckpointFiles().save_checkpoint({"callbacks": {"Diary": {"shadow": torch.ones(1)}}}, path)
    assert torch.load(path, weights_only=True)["callbacks"]["Diary"]["shadow"] == 1


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 1e30])
def test_weights_that_are_no_numbers_end_a_training_in_a_sentence(value: float) -> None:
    layer = torch.nn.Linear(2, 1)
    torch.nn.init.constant_(layer.bias, value)
    layer.kind = "fusion"
    if value == 1e30:
        take_best(layer, None)
        return
    with pytest.raises(UserError, match=r"diverged, .*; lower model\.fusion\.fit\.learning_rate"):
        take_best(layer, None)
