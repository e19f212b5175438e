"""Checkpoint files as Lightning would write them, and the progress bar."""

import io
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from lightning import Trainer
from lightning.fabric.plugins import TorchCheckpointIO
from lightning.pytorch.callbacks import RichProgressBar
from rich.console import Console
from rich.progress import Progress, TextColumn

from tex_lightning.errors import UserError
from tex_lightning.learning.callbacks.progress import ProgressBar
from tex_lightning.learning.train import train_network
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


def test_the_progress_bar_counts_epochs_from_one_and_fits_80_columns(monkeypatch) -> None:
    bar = ProgressBar()
    bar._trainer = Trainer(max_epochs=10, logger=False, enable_checkpointing=False)
    assert [bar._get_train_description(epoch).strip() for epoch in (0, 9)] == [
        "Epoch 1/10",
        "Epoch 10/10",
    ]
    monkeypatch.setattr(
        RichProgressBar,
        "get_metrics",
        lambda self, *_: {"v_num": 1, "train/fragment_accuracy": 0.5} | dict.fromkeys(bar.shown, 1),
    )
    metrics = bar.get_metrics(bar._trainer, None)
    beside = " ".join(f"{name}: {value:.3f}" for name, value in metrics.items())
    assert beside == "loss: 1.000 val_loss: 1.000 votes: 1.000"
    console = Console(width=80, file=io.StringIO())
    shown = Progress(*bar.configure_columns(bar._trainer), TextColumn(beside), console=console)
    shown.add_task(bar._get_train_description(98), total=1000)
    console.print(shown.get_renderable())
    assert len(console.file.getvalue().splitlines()) == 1


def test_what_a_killed_run_kept_to_resume_from_goes_once_it_is_trained(tmp_path: Path) -> None:
    final, working = tmp_path / "haptic.ckpt", tmp_path / "haptic"
    final.touch()
    working.mkdir()
    (working / "last.ckpt").touch()
    assert train_network(SimpleNamespace(final=final, working=working)) == final
    assert not working.exists()
