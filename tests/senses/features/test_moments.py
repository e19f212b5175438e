"""Mean and variance of fragments, against NumPy."""

import numpy as np
import torch

from tex_lightning.senses.features.moments import Moments


def test_fragments_have_the_mean_and_variance_of_their_rows():
    rows = torch.randn(61, 3, generator=torch.Generator().manual_seed(0))
    moments = Moments(61, 7)
    for block in rows.split(5):
        moments.add(2 * block, block, squares=True)
    place = [index * 7 // 61 for index in range(61)]
    parts = [rows[[p == number for p in place]].numpy() for number in range(7)]
    doubled, means = moments.means
    np.testing.assert_allclose(means, [part.mean(axis=0) for part in parts], atol=1e-6)
    np.testing.assert_allclose(doubled, 2 * means, atol=1e-6)
    np.testing.assert_allclose(moments.variance, [part.var(axis=0) for part in parts], atol=1e-6)
