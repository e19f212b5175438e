"""Photos as they come out of their files."""

import numpy as np
import pytest
import torch
from torch import nn

from tex_lightning.data.decode import halve
from tex_lightning.export.photos import PhotoGraph


@pytest.mark.parametrize("size", [(40, 60), (41, 61), (2, 3)])
def test_halving_is_that_of_the_decoder(size):
    photo = np.random.default_rng(0).integers(256, size=(*size, 3), dtype=np.uint8)
    found = PhotoGraph(nn.Identity(), True, least=2)(torch.from_numpy(photo))
    np.testing.assert_array_equal(found[0].permute(1, 2, 0).numpy(), halve(photo))


def test_a_photo_that_is_not_halved_keeps_its_pixels():
    photo = torch.randint(256, (5, 7, 3), dtype=torch.uint8)
    found = PhotoGraph(nn.Identity(), False, least=1)(photo)
    assert torch.equal(found, photo.permute(2, 0, 1)[None])
