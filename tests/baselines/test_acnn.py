"""The network on raw traces: dense evaluation, first filters, settings."""

import numpy as np
import torch

from tex_lightning.baselines.acnn import (
    STRIDE,
    divergence,
    draw_patches,
    fragment_length,
    learn_filters,
    make_network,
)


def test_dense_scores_are_those_of_single_fragments():
    network = make_network(3, width=4, dropout=0.5).eval()
    length = fragment_length(4)
    trace = torch.randn(1, 1, length + 2 * STRIDE + 100)
    with torch.inference_mode():
        dense = network(trace)[0]
        single = [network(trace[..., at : at + length])[0, :, 0] for at in (0, STRIDE, 2 * STRIDE)]
    torch.testing.assert_close(dense, torch.stack(single, dim=1))


def test_patches_have_neither_mean_nor_scale_and_silence_stays():
    patches = draw_patches([3 + 5 * torch.randn(500)], 64, 20)
    torch.testing.assert_close(patches.mean(dim=1), torch.zeros(20), atol=1e-5, rtol=0)
    torch.testing.assert_close(patches.std(dim=1), torch.ones(20))
    assert draw_patches([torch.zeros(100)], 64, 2).abs().sum() == 0


def test_divergence_is_that_of_pytorchs_bernoulli():
    activation = torch.tensor([0.01, 0.05, 0.6])
    aim = torch.distributions.Bernoulli(torch.tensor(0.05))
    reference = torch.distributions.kl_divergence(aim, torch.distributions.Bernoulli(activation))
    torch.testing.assert_close(divergence(activation, 0.05), reference)


def test_filters_follow_the_frequency_of_the_traces():
    torch.manual_seed(0)
    time = torch.arange(4000) / 10_000
    filters = learn_filters([torch.sin(2 * np.pi * 625 * time)], 64, 8, 500, 0.05)
    power = torch.fft.rfft(filters).abs().square().sum(dim=0)
    assert power[4] > 0.8 * power.sum()  # 625 Hz in steps of 156.25
