"""Texture features against NumPy."""

import numpy as np
import pytest
import torch

from tex_lightning.networks.blocks import Window
from tex_lightning.networks.trunks.efficientnet_lite import TextureFeatures


@pytest.mark.parametrize(("window", "step"), [(7, 1), (6, 2)])
def test_every_feature_is_a_mean_over_its_window(window, step):
    rng = np.random.default_rng(0)
    maps = [rng.random((1, channels, 10 * k + (k > 1), 12 * k)) for channels, k in ((3, 4), (5, 1))]
    features = TextureFeatures(Window(window, step), 8).double()
    pooled = [features.pooled(torch.from_numpy(maps[place]), k) for place, k in ((0, 4), (1, 1))]
    found = features(pooled)[0].numpy()
    assert found.shape == (8, (10 - window) // step + 1, (12 - window) // step + 1)
    for row, column in np.ndindex(found.shape[1:]):
        expected = [
            each[0, :, step * row * k :, step * column * k :][:, : window * k, : window * k]
            for each, k in zip(maps, (4, 1), strict=True)
        ]
        means = np.concatenate([each.mean(axis=(1, 2)) for each in expected])
        np.testing.assert_allclose(found[:, row, column], means, rtol=1e-12)


def test_standardised_features_have_mean_zero_and_unit_length():
    torch.manual_seed(0)
    features = TextureFeatures(Window(13, 2), 50)
    rows = 3 + 5 * torch.rand(400, 50)
    standardised = features.standardise(rows)
    torch.testing.assert_close(standardised.mean(dim=0), torch.zeros(50), atol=1e-5, rtol=0)
    assert standardised.square().sum(dim=1).mean() == pytest.approx(1, abs=0.02)
    maps = features([rows[:3, :, None, None]])
    torch.testing.assert_close(maps[..., 0, 0], standardised[:3])


def test_a_feature_that_hardly_varies_is_not_blown_up():
    features = TextureFeatures(Window(13, 2), 1)
    rows = torch.tensor([[1.0], [1.0], [1.001]])
    assert features.standardise(rows).abs().max() < 0.01
