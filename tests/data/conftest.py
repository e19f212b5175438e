import pytest

from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.store import Store


@pytest.fixture
def photos(surfaces, tmp_path):
    """Rows of whole photos and the store that decodes them."""
    rows = read_folder(surfaces).of("image").rows
    return rows, Store(tmp_path, {"image": PhotoDecoder(half_scale=False)})
