"""The accelerated copy of networks of other shapes than this package's."""

import copy
import logging

import pytest
import torch
from conftest import make_card
from own_networks import NODES, settle
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.config.instantiation import trust
from tex_lightning.core.console import Screen
from tex_lightning.export.graph import exportable
from tex_lightning.inference.engine import accelerate
from tex_lightning.networks.folding import FastResponseNorm

DEFAULT = EngineConfig(fast=True, tile=None)
UNTOLD = ("Taken",)  # what these do with their layers only their scores tell


def classifier(node: dict) -> SurfaceClassifier:
    trust("own_networks")
    torch.manual_seed(1)
    card = make_card("haptic")
    card.senses["haptic"]["network"] = copy.deepcopy(node)
    model = SurfaceClassifier(card)
    settle(model.network)
    trace = torch.randn(1, 24_000)
    model.train().partial_logits("haptic", trace)  # what it keeps of a pass has a history
    settle(model.network)
    return model.eval()


@pytest.mark.parametrize("node", NODES, ids=lambda node: next(reversed(node.values())))
def test_the_accelerated_copy_gives_the_scores_of_the_network(node, caplog):
    model, trace = classifier(node), torch.randn(1, 30_000)
    Screen.logged.clear()
    with torch.no_grad(), caplog.at_level(logging.WARNING):
        found = accelerate(model, DEFAULT).logits(haptic=trace)
        expected = model.logits(haptic=trace)
    scale = float(expected.abs().max())
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-3 * scale)
    warned = [record for record in caplog.records if "runs as it was trained" in record.message]
    assert len(warned) == node["_target_"].endswith(UNTOLD)


@pytest.mark.parametrize("node", NODES, ids=lambda node: next(reversed(node.values())))
def test_the_network_of_an_exported_file_gives_the_scores_of_the_network(node):
    model = classifier(node)
    (sense,) = model.senses.values()
    x = sense(torch.randn(1, 30_000))
    with torch.no_grad():
        expected, found = sense.network.features(x, "fc2"), exportable(sense, ["fc2"])
        found = found.features(x, "fc2")
    scale = float(expected.abs().max())
    torch.testing.assert_close(found, expected, rtol=0, atol=1e-3 * scale)


def layers_of(shape: str) -> list[type]:
    fast = accelerate(classifier({"_target_": "own_networks.Shape", "shape": shape}), DEFAULT)
    return [type(layer) for layer in fast.network.layers]


def test_what_holds_whole_is_rewritten():
    for shape in ("grouped", "dilated", "norm_without_weights", "same_and_reflect"):
        assert nn.BatchNorm2d not in layers_of(shape)
    assert FastResponseNorm in layers_of("response_norm")
    assert layers_of("norm_twice").count(nn.BatchNorm2d) == 1
