"""Hydra and its scaling against aeon's own."""

import numpy as np
import torch
from aeon.classification.convolution_based._hydra import _SparseScaler
from aeon.transformations.collection.convolution_based import HydraTransformer

from tex_lightning.baselines.multirocket_hydra import Hydra, SparseScaler


def test_counts_and_scaling_are_aeons():
    series = np.random.default_rng(0).standard_normal((5, 1, 300)).astype(np.float32)
    with torch.random.fork_rng():
        reference = HydraTransformer(4, 8, n_jobs=torch.get_num_threads(), random_state=3)
        expected = reference.fit_transform(series)
    counts = Hydra(4, 8, seed=3).fit_transform(series)
    np.testing.assert_array_equal(counts, expected.numpy())
    scaled = SparseScaler().fit_transform(counts)
    np.testing.assert_allclose(scaled, _SparseScaler().fit_transform(expected).numpy(), atol=1e-4)


def test_stored_kernels_win_over_the_seed():
    series = np.random.default_rng(0).standard_normal((2, 1, 300)).astype(np.float32)
    hydra, other = Hydra(4, 8, seed=3).fit(series), Hydra(4, 8, seed=4).fit(series)
    other.kernels_ = hydra.kernels_
    np.testing.assert_array_equal(other.transform(series), hydra.transform(series))
