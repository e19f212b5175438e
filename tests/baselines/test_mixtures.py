"""Mixtures and naive Bayes against densities written out."""

import numpy as np
import torch
from conftest import make_trace
from scipy.stats import norm

LABELS = np.repeat(np.arange(3), 4)
TRACES = [make_trace(kind, index, 0.6) for kind in range(3) for index in range(4)]


def test_one_component_is_a_gaussian_of_all_frames_of_a_class(configured):
    baseline = configured("mfcc_gmm", components=1)
    baseline.fit(TRACES, LABELS, seed=0)
    frames = [baseline.coefficients(trace, 10_000) for trace in TRACES]
    expected = []
    for kind in range(3):
        own = np.concatenate(frames[4 * kind : 4 * kind + 4])
        deviation = np.sqrt(own.var(axis=0) + baseline.min_variance)
        expected.append(norm.logpdf(frames[2], own.mean(axis=0), deviation).sum())
    np.testing.assert_allclose(baseline.logits(TRACES[2])[:, 0], expected, rtol=1e-6)
    assert baseline.count_parameters() == 3 * (1 + 13 + 13)


def test_naive_bayes_is_a_gaussian_of_the_means_of_a_class(configured):
    baseline = configured("mfcc_nb")
    baseline.fit(TRACES, LABELS, seed=0)
    means = np.stack([baseline.features(trace) for trace in TRACES])
    own = means.reshape(3, 4, 13)
    smoothing = 1e-9 * means.var(axis=0).max()
    deviation = np.sqrt(own.var(axis=1) + smoothing)
    density = norm.logpdf(means[7], own.mean(axis=1), deviation).sum(axis=1)
    scores = torch.log_softmax(torch.from_numpy(density), dim=0)
    scores = scores.clamp(min=np.log(np.finfo(np.float64).tiny))
    torch.testing.assert_close(baseline.logits(TRACES[7])[:, 0], scores)
