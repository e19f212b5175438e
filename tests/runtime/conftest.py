"""The package and the runtime, on the checkpoint and the exported file of one network."""

import pytest

import tex_lightning as tl
from tex_lightning_runtime import Runtime


@pytest.fixture(scope="session")
def model(random_fusion):
    return tl.load(random_fusion)


@pytest.fixture(scope="session")
def runtime(exported):
    return Runtime(exported[1], threads=1)
