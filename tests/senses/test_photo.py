"""Photos: single windows, pieces of large ones, files and pixels."""

from copy import deepcopy

import numpy as np
import pytest
import torch
from conftest import make_card
from PIL import Image

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import MEAN, STD

FIT = {"perturb": [], "perturbed_share": 0.5, "rotation": 180.0}


@pytest.fixture(scope="module")
def sense():
    torch.manual_seed(0)
    return SurfaceClassifier(make_card("visual", width=0.1)).eval().senses["visual"]


def photo(height: int = 330, width: int = 300) -> torch.Tensor:
    rng = np.random.default_rng(0)
    return torch.from_numpy(rng.integers(0, 256, (height, width, 3)).astype(np.uint8))


def pixels(part: torch.Tensor) -> torch.Tensor:
    """Normalised by hand."""
    return ((part / 255 - torch.tensor(MEAN)) / torch.tensor(STD)).permute(2, 0, 1)[None]


@pytest.mark.parametrize(
    ("half", "remedy"),
    [(True, "use a larger one or train with data.half_scale=false."), (False, "use a larger one.")],
)
def test_the_remedy_for_a_small_photo_is_none_that_was_taken(sense, half, remedy):
    small = deepcopy(sense)
    small.decoder = PhotoDecoder(half_scale=half)
    with pytest.raises(UserError, match=rf"has 64x64 pixels after decoding, .*{remedy}$"):
        small.check(photo(64, 64))


def test_a_bank_is_cut_into_turned_crops(sense, tmp_path):
    Image.fromarray(photo(400, 400).numpy()).save(tmp_path / "p.png")
    row = Recording("a", "image", tmp_path / "p.png", 0)
    store = Store(tmp_path, {"image": sense.decoder})
    bank = sense.bank([row], store, FIT, size=224, seed=0, learn=True)
    pieces = bank.cut(np.zeros(2, int), np.random.default_rng(0))
    assert sense.training_input(pieces, 224).shape == (2, 3, 224, 224)
    still = sense.bank([row], store, {**FIT, "rotation": 0.0}, size=224, seed=0, learn=True)
    pieces = still.cut(np.zeros(2, int), np.random.default_rng(0))
    expected = torch.cat([pixels(crop.permute(1, 2, 0)) for crop in pieces["crop"]])
    found = sense.training_input(pieces, 224)
    torch.testing.assert_close(found, expected, atol=1e-3, rtol=0)
    darker = sense.training_input(pieces, 224, lambda photos: photos / 2)
    halved = [pixels((crop / 2).permute(1, 2, 0)) for crop in pieces["crop"].float()]
    torch.testing.assert_close(darker, torch.cat(halved), atol=0.02, rtol=0)
