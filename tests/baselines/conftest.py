"""Baselines with the settings of their configuration."""

import pytest
from omegaconf import OmegaConf

from tex_lightning.baselines.registry import make_baseline
from tex_lightning.config import CONF


@pytest.fixture(scope="session")
def configured():
    def make(name, **changes):
        settings = OmegaConf.to_container(OmegaConf.load(CONF / f"model/{name}.yaml").settings)
        return make_baseline(name, {**settings, **changes})

    return make
