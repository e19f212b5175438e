"""Trunks that start from checkpoints."""

from dataclasses import replace

import pytest
import torch
from conftest import make_card, save_classifier, trunk_node

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.errors import UserError
from tex_lightning.learning.start import start_trunk


def classifier(kind: str, classes: int, **changes) -> SurfaceClassifier:
    names = [f"c{number}" for number in range(classes)]
    given = {"width": 0.1, "trunk": trunk_node("tcnn"), **changes}
    card = make_card(kind, classes=names, **given)
    seen = [f"digest{number}" for number in range(classes)]
    return SurfaceClassifier(replace(card, trained_on={"seen": seen}))


@pytest.mark.parametrize("kind", ["haptic", "visual"])
def test_the_trunk_is_taken_and_the_head_is_not(kind, tmp_path):
    source, target = classifier(kind, 5), classifier(kind, 3)
    head = {key: value.clone() for key, value in target.network.head.state_dict().items()}
    for buffer in source.network.trunk.buffers():
        buffer.add_(1)  # running statistics come along
    path = str(save_classifier(source, tmp_path / "a.ckpt"))
    assert start_trunk(target, path) == f"Trunk from {path}."
    for part, expected in (("trunk", source.network.trunk.state_dict()), ("head", head)):
        found = getattr(target.network, part).state_dict()
        assert found.keys() == expected.keys()
        assert all(torch.equal(found[key], expected[key]) for key in found)


@pytest.mark.parametrize(
    ("kind", "changes"),
    [
        ("haptic", {"width": 0.2}),
        ("visual", {"norm": "lrn"}),
        ("visual", {"trunk": trunk_node("alexnet_caffe")}),
    ],
)
def test_another_trunk_is_refused(kind, changes, tmp_path):
    path = str(save_classifier(classifier(kind, 3, **changes), tmp_path / "a.ckpt"))
    with pytest.raises(UserError, match=f"a.ckpt is another; give model.{kind} the keys"):
        start_trunk(classifier(kind, 3), path)


def test_other_sources_are_refused(tmp_path):
    visual = str(save_classifier(classifier("visual", 3), tmp_path / "a.ckpt"))
    with pytest.raises(UserError, match="holds a visual network where a haptic network"):
        start_trunk(classifier("haptic", 3), visual)
    with pytest.raises(UserError, match="HapticNet starts from a checkpoint"):
        start_trunk(classifier("haptic", 3), "imagenet")
    with pytest.raises(UserError, match="does not exist"):
        start_trunk(classifier("haptic", 3), str(tmp_path / "b.ckpt"))
