"""The LightningModules: parameter groups, schedules, losses."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from conftest import make_card, make_trace, save_classifier
from lightning.pytorch.callbacks import ModelCheckpoint
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import random_tuples
from tex_lightning.config import TrainerConfig
from tex_lightning.config.mistakes import to_user_error
from tex_lightning.core.console import Screen
from tex_lightning.core.contract import fault_of
from tex_lightning.data.banks import InputBank
from tex_lightning.data.datamodule import SurfaceData, TrainingBatches
from tex_lightning.errors import UserError
from tex_lightning.learning.epoch_checkpoints import CheckpointFiles
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.learning.start import start_fusion
from tex_lightning.learning.trainer import make_trainer, quiet_lightning

SCHEDULES = "torch.optim.lr_scheduler"
FIT = {
    "epochs": 5,
    "steps_per_epoch": 20,
    "batch_size": 4,
    "optimizer": {"_target_": "torch.optim.AdamW", "_partial_": True, "weight_decay": 0.01},
    "learning_rate": 1e-3,
    "schedule": {"_target_": f"{SCHEDULES}.OneCycleLR", "_partial_": True},
    "label_smoothing": 0.0,
    "head_factor": 20.0,
}
SENSES = {
    "haptic": ["haptic"],
    "visual": ["visual"],
    "sound": ["sound"],
    "fusion": ["haptic", "visual"],
    "three": ["haptic", "visual", "sound"],
}
VOTES = ("loss", "fragment_accuracy", "vote_accuracy")
PIECES = {"haptic": 240, "visual": 224, "sound": 256}


def module(kind: str, **changes) -> SurfaceModule:
    senses = SENSES[kind]
    card = make_card(*senses, width=0.1)
    torch.manual_seed(0)
    pieces = {name: PIECES[name] for name in senses}
    return SurfaceModule(card, {**FIT, **changes}, 0, pieces)


def quiet(model: SurfaceModule) -> SurfaceModule:
    """A module whose steps can be taken without a trainer."""
    model.log = model.log_dict = lambda *args, **kwargs: None
    model._trainer = SimpleNamespace(
        log_every_n_steps=10, global_step=0, optimizers=[SimpleNamespace(param_groups=[])]
    )
    return model


def batch_of_three(samples: int) -> dict:
    """Pieces of the size that gives one position; of photos larger, to be turned."""
    torch.manual_seed(1)
    crops = torch.randint(0, 256, (samples, 3, 320, 320), dtype=torch.uint8)
    return {
        "label": torch.arange(samples) % 3,
        "haptic": {"input": torch.randn(samples, 1, 50, 192)},
        "visual": {"crop": crops, "degrees": torch.linspace(-180, 180, samples)},
        "sound": {"input": torch.randn(samples, 1, 50, 192)},
    }


@pytest.mark.parametrize("kind", ["haptic", "three"])
def test_every_parameter_is_in_exactly_one_group(kind):
    model = module(kind)
    groups = model.configure_optimizers()["optimizer"].param_groups
    grouped = [id(parameter) for group in groups for parameter in group["params"]]
    assert sorted(grouped) == sorted(id(parameter) for parameter in model.parameters())
    assert [group["name"] for group in groups] == ["backbone", "head"]


@pytest.mark.parametrize(
    ("node", "message"),
    [
        (
            {"_target_": "torch.optim.Adan", "_partial_": True},
            "^model.haptic.fit.optimizer fails: ",
        ),
        ({"lr": 1}, "fit.optimizer has no _target_"),
        ({"_target_": "datetime.timedelta"}, "add _partial_: true"),
    ],
)
def test_an_optimizer_that_cannot_be_made_says_why(node, message):
    with pytest.raises(UserError, match=message):
        module("haptic", optimizer=node).configure_optimizers()


def test_an_optimizer_gets_the_learning_rate_if_it_has_no_default_of_it():
    node = {"_target_": "own_parts.Descent", "_partial_": True}
    made = module("haptic", optimizer=node).configure_optimizers()["optimizer"]
    assert made.defaults["lr"] == module("haptic").fit_config["learning_rate"]


def test_what_an_optimizer_or_a_schedule_raises_is_told_with_its_key():
    model = module("haptic", optimizer={"_target_": "own_parts.Slipping", "_partial_": True})
    made = model.configure_optimizers()
    with pytest.raises(KeyError) as caught:
        made["optimizer"].step()
    assert fault_of(caught.value) == "model.haptic.fit.optimizer (Slipping) raised KeyError."
    schedule = made["lr_scheduler"]["scheduler"]
    schedule.last_epoch = schedule.total_steps  # as a callback that trains for longer leads to
    with pytest.raises(ValueError, match="Tried to step") as beyond:
        schedule.step()
    said = "model.haptic.fit.schedule (OneCycleLR) fails: Tried to step"
    assert str(to_user_error(beyond.value, began=True)).startswith(said)


@pytest.mark.parametrize("target", [f"{SCHEDULES}.ReduceLROnPlateau", "torch.nn.Identity"])
def test_what_does_not_go_by_steps_is_no_schedule(target):
    with pytest.raises(
        UserError, match=r"^model\.haptic\.fit\.schedule is .* does not go by the number"
    ):
        module("haptic", schedule={"_target_": target, "_partial_": True}).configure_optimizers()


def test_the_loss_is_the_mean_cross_entropy_of_all_fragments():
    model = quiet(module("haptic"))
    model.eval()  # no dropout, so that the network can be asked again
    spectrogram = torch.randn(4, 1, 50, 240)
    batch = {"haptic": {"input": spectrogram}, "label": torch.tensor([0, 1, 2, 0])}
    loss = model.training_step(batch, 0)
    logits = model.classifier.network(spectrogram)
    by_hand = [
        -torch.log_softmax(logits[i, :, t], dim=0)[batch["label"][i]]
        for i in range(4)
        for t in range(logits.shape[2])
    ]
    assert logits.shape[2] == 4
    torch.testing.assert_close(loss, torch.stack(by_hand).mean())


def test_training_inputs_are_computed_in_float32_within_mixed_precision():
    model, batch = module("visual").train(), batch_of_three(2)
    model.augmentation = nn.Conv2d(3, 3, 3, padding=1).requires_grad_(False)
    (expected,) = model.inputs(batch)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        (found,) = model.inputs(batch)
    torch.testing.assert_close(found, expected, rtol=0, atol=0)


def test_metrics_are_logged_after_an_epoch_and_not_after_every_sample():
    """Lightning moves all that a logged metric keeps, which would be quadratic in the samples."""
    model, logged = quiet(module("haptic").eval()), {}
    model.log = lambda name, value, **_: logged.setdefault(name, value)
    model._trainer.world_size = 1
    recordings = {"haptic": torch.from_numpy(make_trace(0, 0))[None]}
    label = model.classifier.logits(**recordings).mean(dim=1).argmax()
    model.on_validation_epoch_start()
    for truth in (label, label, (label + 1) % 3):
        model.validation_step({"label": truth, "recordings": recordings}, 0)
    assert list(logged) == ["val/loss"]
    shares = model.classifier.logits(**recordings).detach().softmax(dim=0)[label]
    assert float(logged["val/loss"].detach()) == pytest.approx(float(-shares.log().mean()))
    model.on_validation_epoch_end()
    assert sorted(logged) == sorted(f"val/{name}" for name in VOTES)
    assert float(logged["val/vote_accuracy"].compute()) == pytest.approx(2 / 3)


def test_the_fusion_layer_learns_twenty_times_as_fast_as_the_networks():
    """In the paper 10 to 50 times, for the last layer."""
    model = module("fusion")
    optimizer = model.configure_optimizers()["optimizer"]
    rates = {group["name"]: group["max_lr"] for group in optimizer.param_groups}
    assert rates == {"backbone": pytest.approx(1e-3), "head": pytest.approx(2e-2)}
    (head,) = (group["params"] for group in optimizer.param_groups if group["name"] == "head")
    assert {id(each) for each in head} == {
        id(each) for each in model.classifier.fusion.parameters()
    }


def test_fusion_keeps_the_statistics_of_batch_normalisation():
    model = module("fusion").train()
    norms = [layer for layer in model.modules() if isinstance(layer, nn.BatchNorm2d)]
    assert norms
    assert not any(layer.training for layer in norms)
    assert any(layer.training for layer in model.modules() if isinstance(layer, nn.Dropout))
    assert model(*model.inputs(batch_of_three(1))).shape == (1, 3, 1)


def test_fusion_starts_from_checkpoints_of_three_senses(tmp_path):
    paths = {}
    for name in SENSES["three"]:
        single = module(name)
        for buffer in single.classifier.senses[name].features.buffers():
            buffer.add_(0.5)  # what features have learnt comes along
        paths[name] = save_classifier(single.classifier, tmp_path / f"{name}.ckpt")
    model = module("three")
    starts = {name: SurfaceClassifier.from_checkpoint(path) for name, path in paths.items()}
    start_fusion(model, starts, "scores")
    networks = [sense.network for sense in model.classifier.senses.values()]
    assert not any(network.training for network in networks)  # without dropout
    classifier = model.eval().classifier
    rng = torch.Generator().manual_seed(0)
    sample = {
        "haptic": torch.randn(1, 24_000, generator=rng),
        "image": torch.randint(0, 256, (240, 240, 3), generator=rng, dtype=torch.uint8),
        "sound": torch.randn(1, 105_840, generator=rng),
    }
    alone = []
    for name, sense in classifier.senses.items():
        start = SurfaceClassifier.from_checkpoint(paths[name], name)
        alone.append(start.logits(**sample))
        assert torch.equal(
            sense(sample[sense.modality]), start.senses[name](sample[sense.modality])
        )
    counts = [each.shape[1] for each in alone]
    tuples = random_tuples(counts, 50, classifier.seed(**sample))
    expected = sum(each[:, tuples[:, place]] for place, each in enumerate(alone))
    torch.testing.assert_close(classifier.logits(**sample), expected, rtol=1e-4, atol=1e-4)


def rates_of(folder: Path, precision: str = "32-true", **flags: object) -> list[float]:
    """The learning rates of the head in every step of two epochs of six batches."""
    settings = TrainerConfig("cpu", 1, 1, "auto", precision, False)
    for name, value in flags.items():
        setattr(settings, name, value)
    model, rates = module("haptic", epochs=2, steps_per_epoch=6, augmentation=None), []
    bank = InputBank([torch.rand(1, 50, 300) for _ in range(4)], frames=192)
    batches = TrainingBatches({"haptic": (bank, np.array([0, 1, 2, 0]))}, batch_size=2, seed=0)
    working = folder / "checkpoints" / "haptic"
    with quiet_lightning():
        trainer = make_trainer(settings, [], [], model.fit_config, working, validated=False)
        model.on_before_optimizer_step = lambda *_: rates.append(
            trainer.optimizers[0].param_groups[-1]["lr"]
        )
        trainer.fit(model, datamodule=SurfaceData(batches, 6, None, 0))
    return rates


@pytest.mark.parametrize(
    ("flags", "steps"),
    [
        ({}, 12),
        ({"accumulate_grad_batches": 4}, 4),
        ({"max_steps": 7}, 7),
        ({"limit_train_batches": 3}, 6),
        ({"limit_train_batches": 0.5, "accumulate_grad_batches": 2}, 4),
        ({"max_epochs": 1}, 6),
        ({"max_epochs": 3, "max_steps": 15}, 15),
        ({"max_epochs": -1, "max_steps": 8}, 8),
        ({"precision": "bf16-mixed", "gradient_clip_val": 0.5}, 12),
        ({"gradient_clip_val": 0.5}, 12),
    ],
)
def test_the_schedule_ends_where_the_training_does(tmp_path, flags, steps):
    rates = rates_of(tmp_path, **flags)
    assert len(rates) == steps
    assert rates[-1] < 1e-3 * max(rates)  # the end of OneCycleLR


def test_a_fit_in_closed_form_takes_no_step_whatever_the_flags_say(tmp_path):
    settings, working = TrainerConfig("cpu", 1, 1, "auto", "32-true", False), tmp_path / "a" / "b"
    for value in (3, "three"):
        settings.max_epochs = value
        none = {**FIT, "epochs": 0}
        trainer = make_trainer(settings, [], [], none, working, validated=False)
        assert trainer.max_epochs == 0
    with pytest.raises(UserError, match=r"max_epochs=three is no number.* model\.b\.fit\.epochs"):
        make_trainer(settings, [], [], FIT, working, validated=False)


def test_flags_that_are_keys_of_the_recipe_are_answered_with_these(tmp_path, caplog, monkeypatch):
    monkeypatch.setattr(Screen, "logged", set())
    settings, working = TrainerConfig("cpu", 1, 1, "auto", "32-true", False), tmp_path / "haptic"
    settings.max_epochs = 3
    with caplog.at_level("INFO"):
        trainer = make_trainer(settings, [], [], FIT, working, validated=False)
    assert trainer.max_epochs == 3  # as every flag of Lightning's
    assert "of every network of this run, model.haptic.fit.epochs of one." in caplog.text
    settings.limit_train_batch = 4
    near = r"\(did you mean trainer\.limit_train_batches\?\); correct that flag\."
    with pytest.raises(UserError, match=near):
        make_trainer(settings, [], [], FIT, working, validated=False)
    del settings.limit_train_batch
    settings.batch_size = 4
    with pytest.raises(UserError, match=r"correct that flag, or give model\.haptic\.fit\.batch_s"):
        make_trainer(settings, [], [], FIT, working, validated=False)


def test_flags_that_are_objects_are_built_and_some_are_not_the_users(tmp_path):
    settings = TrainerConfig("cpu", 1, 1, "auto", "32-true", False)
    settings.profiler = {"_target_": "lightning.pytorch.profilers.SimpleProfiler"}
    environment = "lightning.pytorch.plugins.environments.LightningEnvironment"
    settings.plugins = [{"_target_": environment}]
    trainer = make_trainer(settings, [], [], FIT, tmp_path / "a" / "b", validated=False)
    assert type(trainer.profiler).__name__ == "SimpleProfiler"
    assert isinstance(trainer.strategy.checkpoint_io, CheckpointFiles)
    settings.callbacks = []
    with pytest.raises(UserError, match=r"trainer\.callbacks is set by .*\[default,NAME"):
        make_trainer(settings, [], [], FIT, tmp_path / "a" / "b", validated=False)


def test_a_users_checkpoints_are_kept_beside_those_of_the_package(tmp_path):
    settings = TrainerConfig("cpu", 1, 1, "auto", "32-true", False)
    own = ModelCheckpoint(tmp_path, monitor="val/loss", save_on_train_epoch_end=True)
    trainer = make_trainer(settings, [own], [], FIT, tmp_path / "a" / "b", validated=True)
    assert trainer.checkpoint_callback is not own  # which is where the best epoch is taken from
