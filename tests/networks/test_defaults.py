"""A network that is made in Python is the one that the command line trains."""

import inspect

import pytest
import torch
from omegaconf import OmegaConf

import tex_lightning as tl
from tex_lightning.config import CONF
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.networks.trunks.alexnet import CaffeAlexNet
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.senses.making import make_sense

CLASSES = 3
MADE = {
    "haptic": (lambda: tl.HapticNet(CLASSES), (1, 1, 50, 300)),
    "visual": (
        lambda: tl.VisualNet(CLASSES, CaffeAlexNet(width=0.25, norm="batch")),
        (1, 3, 230, 240),
    ),
}


@pytest.mark.parametrize("sense", MADE)
def test_python_and_the_command_line_make_the_same_network(sense):
    made, shape = MADE[sense]
    torch.manual_seed(0)
    ours = made()
    torch.manual_seed(0)
    node = read_config(compose_config([f"model={sense}"])).model.sense(sense).node
    theirs = make_sense(sense, node, CLASSES).network
    one, other = ours.state_dict(), theirs.state_dict()
    assert {name: x.shape for name, x in one.items()} == {
        name: x.shape for name, x in other.items()
    }
    assert all(torch.equal(x, other[name]) for name, x in one.items())
    x = torch.rand(shape)
    for mode in (True, False):  # of training, where dropout draws
        torch.manual_seed(1)
        expected = theirs.train(mode)(x)
        torch.manual_seed(1)
        assert torch.equal(ours.train(mode)(x), expected)


def test_a_fusion_in_python_has_the_weights_of_the_command_lines():
    networks = [made() for made, _ in MADE.values()]
    fused = tl.FusionNet(*networks, classes=CLASSES)
    level = read_config(compose_config(["model=fusion"])).model.fusion.level
    again = tl.FusionNet(*networks, classes=CLASSES, level=level)
    assert [x.shape for x in fused.parameters()] == [x.shape for x in again.parameters()]


@pytest.mark.parametrize(
    ("called", "sense"),
    [(tl.HapticNet, "haptic"), (SpectrogramFeatures, "haptic"), (tl.VisualNet, "visual")],
)
def test_a_default_in_python_is_that_of_the_file(called, sense):
    file = OmegaConf.to_container(OmegaConf.load(CONF / "sense" / f"{sense}.yaml"))
    compared = 0
    for name, parameter in inspect.signature(called).parameters.items():
        if parameter.default is not parameter.empty and name in file:
            value = list(parameter.default) if name == "head" else parameter.default
            assert file[name] == value, name
            compared += 1
    assert compared >= 3
