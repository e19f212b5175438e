"""Photos: single windows, pieces of large ones, files and pixels."""

from copy import deepcopy

import numpy as np
import pytest
import torch
from conftest import make_card
from PIL import Image
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import MEAN, STD
from tex_lightning.senses.photo import PhotoSense

FIT = {"perturb": [], "perturbed_share": 0.5, "rotation": 180.0}


@pytest.fixture(scope="module")
def sense():
    torch.manual_seed(0)
    return SurfaceClassifier(make_card("visual", width=0.1)).eval().senses["visual"]


def changed(sense, **values):
    copied = deepcopy(sense)
    for name, value in values.items():
        setattr(copied, name, value)
    return copied


def photo(height: int = 330, width: int = 300) -> torch.Tensor:
    rng = np.random.default_rng(0)
    return torch.from_numpy(rng.integers(0, 256, (height, width, 3)).astype(np.uint8))


def pixels(part: torch.Tensor) -> torch.Tensor:
    """Normalised by hand."""
    return ((part / 255 - torch.tensor(MEAN)) / torch.tensor(STD)).permute(2, 0, 1)[None]


@pytest.mark.parametrize(
    ("decoder", "remedy"),
    [
        (PhotoDecoder(half_scale=True), "use a larger one or train with data.half_scale=false."),
        (PhotoDecoder(half_scale=False), "use a larger one."),
        (PhotoDecoder(half_scale=False, resize=64), "or train with a larger data.resize."),
    ],
)
def test_the_remedy_for_a_small_photo_is_none_that_was_taken(sense, decoder, remedy):
    with pytest.raises(UserError) as caught:
        changed(sense, decoder=decoder).check(photo(64, 64))
    assert str(caught.value).endswith(remedy)


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


class Stripes(nn.Module):
    """A user's network, which says nothing of its geometry."""

    def __init__(self, classes: int) -> None:
        super().__init__()
        self.convolution = nn.Conv2d(3, classes, 40, stride=20)

    def features(self, x: torch.Tensor, level: str) -> torch.Tensor:
        return self.convolution(x)


@torch.no_grad()
def test_the_geometry_of_a_users_network_is_found_by_trying(sense):
    own = PhotoSense("visual", "image", sense.decoder, sense.features, Stripes(3))
    own.tile = 100
    assert own.positions(photo(80, 60), "fc3").shape == (3, 3 * 2)
    own.check(photo(40, 40))
    with pytest.raises(
        UserError, match="has 200x39 pixels after decoding, and this network needs 40"
    ):
        own.check(np.zeros((39, 200, 3), np.uint8))
    assert own.piece_size(100) == 40
