"""The LightningModules: parameter groups, schedules, losses."""

from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from conftest import trunk_node
from torch import nn

from tex_lightning.card import Card
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.errors import UserError
from tex_lightning.learning.callbacks.fusion import FusionStart
from tex_lightning.learning.fusion import FusionModule
from tex_lightning.learning.haptic import HapticModule
from tex_lightning.learning.visual import VisualModule

SCHEDULES = "torch.optim.lr_scheduler"
NETWORK = {"width": 0.1, "norm": "batch", "dropout": 0.5}
FIT = {
    "epochs": 5,
    "steps_per_epoch": 20,
    "batch_size": 4,
    "optimizer": {"_target_": "torch.optim.AdamW", "_partial_": True, "weight_decay": 0.01},
    "learning_rate": 1e-3,
    "schedule": {"_target_": f"{SCHEDULES}.OneCycleLR", "_partial_": True},
    "label_smoothing": 0.0,
    "head_factor": 20.0,
    "patch": 224,
    "modality_dropout": 0.0,
}
MODULES = {"haptic": HapticModule, "visual": VisualModule, "fusion": FusionModule}


def module(kind: str, **changes):
    card = Card(
        kind=kind,
        classes=["a", "b", "c"],
        decode=DecodeSettings().to_dict(),
        decision={"pairs": 10, "seed": 0},
        haptic_network=NETWORK,
        visual_network={**NETWORK, "trunk": trunk_node("alexnet_caffe")},
        fusion={"level": "fc2"},
    )
    torch.manual_seed(0)
    return MODULES[kind](card.to_dict(), {**FIT, **changes}, 0)


def rates(model, steps: int) -> list[tuple[float, float]]:
    configured = model.configure_optimizers()
    optimizer, scheduler = configured["optimizer"], configured["lr_scheduler"]["scheduler"]
    found = []
    for _ in range(steps):
        groups = {group["name"]: group["lr"] for group in optimizer.param_groups}
        found.append((groups["backbone"], groups["head"]))
        optimizer.step()
        scheduler.step()
    return found


@pytest.mark.parametrize("kind", MODULES)
def test_every_parameter_is_in_exactly_one_group(kind):
    model = module(kind)
    groups = model.configure_optimizers()["optimizer"].param_groups
    grouped = [id(parameter) for group in groups for parameter in group["params"]]
    assert sorted(grouped) == sorted(id(parameter) for parameter in model.parameters())
    assert [group["name"] for group in groups] == ["backbone", "head"]


def test_fusions_head_is_the_fusion_layer_alone():
    head = module("fusion").configure_optimizers()["optimizer"].param_groups[1]["params"]
    assert [tuple(parameter.shape) for parameter in head] == [(3, 50), (3,)]


def test_step_decay_follows_its_closed_form():
    step_lr = {"_target_": f"{SCHEDULES}.StepLR", "_partial_": True, "gamma": 0.1, "step_size": 30}
    for step, (backbone, head) in enumerate(rates(module("haptic", schedule=step_lr), 70)):
        assert backbone == pytest.approx(1e-3 * 0.1 ** (step // 30))
        assert head == pytest.approx(20 * backbone)


def test_one_cycle_rises_to_the_rate_and_falls_to_nothing():
    found = rates(module("haptic"), 100)
    backbone = [pair[0] for pair in found]
    assert max(backbone) == pytest.approx(1e-3, rel=1e-2)
    assert backbone[0] < 1e-4
    assert backbone[-1] < 1e-6
    assert all(head == pytest.approx(20 * base) for base, head in found)


def test_any_optimizer_and_schedule_can_be_named():
    sgd = {"_target_": "torch.optim.SGD", "_partial_": True, "momentum": 0.9}
    cosine = {"_target_": f"{SCHEDULES}.CosineAnnealingLR", "_partial_": True}
    model = module("haptic", optimizer=sgd, schedule=cosine)
    optimizer = model.configure_optimizers()["optimizer"]
    assert type(optimizer) is torch.optim.SGD
    assert optimizer.param_groups[0]["momentum"] == 0.9
    assert rates(model, 101)[100] == pytest.approx((0, 0))  # T_max is the number of steps


@pytest.mark.parametrize(
    ("node", "message"),
    [
        ({"_target_": "torch.optim.Adan", "_partial_": True}, "fit.optimizer cannot be made: "),
        ({"_target_": "torch.optim.SGD", "_partial_": True, "x": 1}, "unexpected keyword argument"),
        ({"lr": 1}, "fit.optimizer has no _target_"),
        ({"_target_": "datetime.timedelta"}, "add _partial_: true"),
    ],
)
def test_an_optimizer_that_cannot_be_made_says_why(node, message):
    with pytest.raises(UserError, match=message):
        module("haptic", optimizer=node).configure_optimizers()


def test_the_loss_is_the_mean_cross_entropy_of_all_fragments():
    model = module("haptic")
    model.eval()  # no dropout, so that the network can be asked again
    model.log = lambda *args, **kwargs: None
    model._trainer = SimpleNamespace(
        log_every_n_steps=10, global_step=0, optimizers=[SimpleNamespace(param_groups=[])]
    )
    batch = {"spectrogram": torch.randn(4, 1, 50, 240), "label": torch.tensor([0, 1, 2, 0])}
    loss = model.training_step(batch, 0)
    logits = model.classifier.network(batch["spectrogram"])
    by_hand = [
        -torch.log_softmax(logits[i, :, t], dim=0)[batch["label"][i]]
        for i in range(4)
        for t in range(logits.shape[2])
    ]
    assert logits.shape[2] == 4
    torch.testing.assert_close(loss, torch.stack(by_hand).mean())


def test_fusion_keeps_the_statistics_of_batch_normalisation():
    model = module("fusion").train()
    norms = [layer for layer in model.modules() if isinstance(layer, nn.BatchNorm2d)]
    assert norms
    assert not any(layer.training for layer in norms)
    assert any(layer.training for layer in model.modules() if isinstance(layer, nn.Dropout))
    crops = torch.randint(0, 256, (1, 3, 320, 320), dtype=torch.uint8)
    batch = {"spectrogram": torch.randn(1, 1, 50, 192), "crop": crops, "degrees": torch.zeros(1)}
    assert model.classifier.network(*model.inputs(batch)).shape == (1, 3, 1)


@pytest.mark.parametrize("factor", [9.9, 50.1])
def test_the_head_factor_has_the_papers_range(factor):
    with pytest.raises(UserError, match="from 10 to 50"):
        FusionStart(Path("h.ckpt"), Path("v.ckpt"), factor)
    FusionStart(Path("h.ckpt"), Path("v.ckpt"), 10.0)


def test_a_dropped_modality_leaves_the_other_halfs_scores(monkeypatch):
    model = module("fusion", modality_dropout=0.4)
    haptic, visual = torch.randn(2, 4000, 3, 1)
    monkeypatch.setattr(model, "inputs", lambda batch: ())
    monkeypatch.setattr(model.network, "parts", lambda: (haptic, visual))
    scores = model.scores({})
    count = {
        name: int((scores == expected).flatten(1).all(1).sum())
        for name, expected in {"h": haptic, "v": visual, "both": haptic + visual}.items()
    }
    assert sum(count.values()) == 4000
    assert count["h"] == pytest.approx(800, abs=100)
    assert count["v"] == pytest.approx(800, abs=100)
