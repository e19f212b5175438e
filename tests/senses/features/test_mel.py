"""Mel filters against their formula and librosa's, and what holds for every rate."""

import numpy as np
import pytest
import torch

from tex_lightning.senses.features.spectrogram import mel_centres, mel_filters


def test_filters_are_triangles_whose_corners_are_even_on_the_mel_scale():
    corners = 700 * (10 ** (np.linspace(0, 2595 * np.log10(1 + 5000 / 700), 52) / 2595) - 1)
    low, centre, high = (corners[start : start + 50, None] for start in range(3))
    hertz = np.arange(251) * 20.0
    rising, falling = (hertz - low) / (centre - low), (high - hertz) / (high - centre)
    theirs = torch.from_numpy(np.minimum(rising, falling).clip(0))
    wide = theirs.sum(dim=1, keepdim=True)
    assert bool((wide > 0).all())
    torch.testing.assert_close(
        mel_filters(10_000, 500, 50), (theirs / wide).float(), atol=1e-4, rtol=1e-3
    )


@pytest.mark.parametrize("rate", [500.0, 2_800.0, 10_000.0, 44_100.0])
def test_every_band_has_power_at_every_rate(rate):
    filters, centres = mel_filters(rate, 500, 50), mel_centres(rate, 50)
    assert filters.min() >= 0
    torch.testing.assert_close(filters.sum(dim=1), torch.ones(50))
    assert bool((centres.diff() > 0).all())
    means = filters.double() @ (torch.arange(251) * rate / 500).double()
    assert float(((means - centres).abs() / (rate / 500)).max()) < 1.0
