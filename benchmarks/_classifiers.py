"""Classifiers of the configured networks with random weights."""

from functools import cache

import torch
from torch import nn

from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config


@cache
def configured(*overrides: str) -> Config:
    """Return the configuration as a command line composes it; it is shared and stays as it is."""
    return read_config(compose_config(overrides))


def make_classifier(*overrides: str, classes: int = 16) -> SurfaceClassifier:
    """A classifier whose scores vary, as a trained one's do, of the model in ``overrides``."""
    torch.manual_seed(0)
    config = configured(*overrides)
    names = [f"class{number}" for number in range(classes)]
    classifier = SurfaceClassifier(configured_card(config, names)).eval()
    for sense in classifier.senses.values():
        for layer in sense.network.get_submodule("head").modules():
            if isinstance(layer, nn.Conv2d):
                nn.init.kaiming_normal_(layer.weight)
    return classifier
