from functools import cache

import pytest

from tex_lightning.synthetic.materials import make_materials
from tex_lightning.synthetic.specimen import Specimen


@pytest.fixture(scope="session")
def specimen():
    """Give class 0 to 5 of seed 0, made up once for the whole session."""
    return cache(lambda index: Specimen(make_materials(6, 0)[index]))
