"""Callbacks and flags of a user, and what a killed run leaves."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from conftest import make_card, save_checkpoint
from lightning.pytorch.utilities.exceptions import MisconfigurationException

from tex_lightning.config.mistakes import to_user_error
from tex_lightning.core.contract import fault_of
from tex_lightning.errors import UserError
from tex_lightning.learning.train import Training
from tex_lightning.learning.trainer import build_callbacks


def test_a_callback_whose_method_takes_other_arguments_is_refused():
    said = (
        r"^callbacks\.mine \(FewArguments\) has on_train_epoch_end, which takes trainer, where it"
    )
    with pytest.raises(UserError, match=f"{said} gets trainer, pl_module; a callback's methods"):
        build_callbacks({"mine": {"_target_": "own_parts.FewArguments"}}, {})
    for name in ("SeesBatches", "TakesStage"):
        (callback,) = build_callbacks({"mine": {"_target_": f"own_parts.{name}"}}, {})
        assert type(callback).__name__ == name
        callback.setup(None, None, stage="fit")  # as Lightning calls it


def test_what_a_callback_raises_is_told_with_its_key():
    (callback,) = build_callbacks({"mine": {"_target_": "own_parts.Breaking"}}, {})
    with pytest.raises(KeyError) as caught:
        callback.on_train_epoch_end()
    assert fault_of(caught.value) == "callbacks.mine (Breaking) raised KeyError."


def test_what_a_callback_of_lightning_rejects_is_a_mistake_in_its_key():
    target = "lightning.pytorch.callbacks.EarlyStopping"
    (callback,) = build_callbacks({"stop": {"_target_": target, "monitor": "val/los"}}, {})
    trainer: Any = SimpleNamespace(
        fast_dev_run=False, sanity_checking=False, callback_metrics={"val/loss": torch.tensor(1.0)},
        state=SimpleNamespace(fn="fit"),
    )  # fmt: skip
    with pytest.raises(RuntimeError) as caught:
        callback.on_validation_end(trainer, None)
    mistake = to_user_error(caught.value, began=True)
    assert "callbacks.stop (EarlyStopping) fails: Early stopping cond" in str(mistake)
    assert to_user_error(RuntimeError("of the program"), began=True) is None


def test_what_lightning_finds_deeper_inside_is_the_callbacks_or_a_flags():
    target = "lightning.pytorch.callbacks.BackboneFinetuning"
    (callback,) = build_callbacks({"tune": {"_target_": target}}, {})
    with pytest.raises(AttributeError) as caught:  # of torch.nn.Module
        callback.freeze_before_training(torch.nn.Linear(2, 1))
    mistake = to_user_error(caught.value, began=True)
    assert str(mistake).startswith("callbacks.tune (BackboneFinetuning) fails: 'Linear' object has")
    mistake = to_user_error(MisconfigurationException("0.5 * 1 < 1"), began=True)
    assert str(mistake) == "Lightning rejects a flag of trainer: 0.5 * 1 < 1; correct that flag."


def test_what_a_killed_run_kept_to_resume_from_goes_once_it_is_trained(tmp_path: Path) -> None:
    card = make_card("haptic", width=0.1)
    training = Training(None, card, None, None, tmp_path)
    training.epochs_folder.mkdir(parents=True)
    save_checkpoint(card, training.checkpoint)
    (training.epochs_folder / "last.ckpt").touch()
    assert training.run().card == card
    assert not training.epochs_folder.exists()
