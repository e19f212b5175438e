"""Baselines with the settings of their configuration."""

import pytest
from omegaconf import OmegaConf

from tex_lightning.baselines.classifier import make_baseline
from tex_lightning.config import CONF


@pytest.fixture(scope="session")
def configured():
    def make(name, **changes):
        node = OmegaConf.to_container(OmegaConf.load(CONF / f"model/{name}.yaml").baseline)
        return make_baseline(name, {**node, **changes}, 1)

    return make
