"""Texture features against NumPy."""

import pytest
import torch

from tex_lightning.networks.blocks import Window
from tex_lightning.networks.trunks.efficientnet_lite import TextureFeatures


def test_standardised_features_have_mean_zero_and_unit_length():
    torch.manual_seed(0)
    features = TextureFeatures(Window(13, 2), 50)
    rows = 3 + 5 * torch.rand(400, 50)
    standardised = features.standardise(rows)
    torch.testing.assert_close(standardised.mean(dim=0), torch.zeros(50), atol=1e-5, rtol=0)
    assert standardised.square().sum(dim=1).mean() == pytest.approx(1, abs=0.02)
    maps = features([rows[:3, :, None, None]])
    torch.testing.assert_close(maps[..., 0, 0], standardised[:3])
