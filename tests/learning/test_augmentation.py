"""Kornia's operations on the training patches of VisualNet, and nowhere else."""

import pytest
import torch
from conftest import make_card, trunk_node

from tex_lightning.errors import UserError
from tex_lightning.learning.module import SurfaceModule

FLIP = {"_target_": "kornia.augmentation.RandomHorizontalFlip", "p": 1.0}
INVERT = {"_target_": "kornia.augmentation.RandomInvert", "p": 1.0}  # 1 - x of pixels in [0, 1]


def module(augmentation: dict | None) -> SurfaceModule:
    card = make_card("visual", trunk=trunk_node("tcnn"), width=0.05)
    fit = {"head_factor": 1.0, "augmentation": augmentation}
    return SurfaceModule(card, fit, 0, {"visual": 224})


@pytest.fixture
def batch() -> dict[str, dict[str, torch.Tensor]]:
    torch.manual_seed(0)
    crop = torch.randint(0, 256, (2, 3, 224, 224), dtype=torch.uint8)
    return {"visual": {"crop": crop, "degrees": torch.zeros(2)}}


def test_a_container_changes_training_patches_alone(batch):
    (plain,) = module(None).inputs(batch)
    both = {"_target_": "kornia.augmentation.AugmentationSequential", "_args_": [FLIP, INVERT]}
    augmented = module(both)
    (changed,) = augmented.inputs(batch)
    features = augmented.classifier.senses["visual"].features
    expected = 1 - (plain * features.std + features.mean).flip(3)
    torch.testing.assert_close(changed, (expected - features.mean) / features.std)
    (left,) = augmented.eval().inputs(batch)
    assert torch.equal(left, plain)
    assert not [name for name in augmented.state_dict() if "augmentation" in name]


def test_what_fails_on_patches_is_said(batch):
    wrong = module({"_target_": "torch.nn.Linear", "in_features": 3, "out_features": 3})
    with pytest.raises(RuntimeError) as caught:
        wrong.inputs(batch)
    assert "fit.augmentation (Linear) raised RuntimeError" in caught.value.__notes__[0]
    flat = module({"_target_": "torch.nn.Flatten"})
    with pytest.raises(
        UserError, match=r"returned a Tensor of float32 of shape \(2, 150528\) for a batch of 2"
    ):
        flat.inputs(batch)
    with pytest.raises(
        UserError, match=r"\(Bytes\) returned a Tensor of uint8 of shape \(2, 3, 224"
    ):
        module({"_target_": "own_parts.Bytes"}).inputs(batch)
