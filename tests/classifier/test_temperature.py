import numpy as np
import pytest
import torch
from scipy.special import softmax

from tex_lightning.classifier.vote import max_vote
from tex_lightning.networks.linear import fit_temperature


@pytest.mark.parametrize("scale", [0.5, 1.0, 3.0])
def test_the_scale_of_overconfident_logits_is_found(scale):
    rng = np.random.default_rng(0)
    logits = rng.normal(size=(4000, 3)) * 2
    labels = [int(rng.choice(3, p=p)) for p in softmax(logits, axis=1)]
    fragments = [torch.from_numpy(row * scale)[:, None] for row in logits]
    assert fit_temperature(fragments, labels) == pytest.approx(scale, rel=0.1)


def test_a_few_right_samples_do_not_make_infinitely_sure():
    logits = [torch.tensor([[4.0], [0.0], [0.0]])] * 8
    temperature = fit_temperature(logits, [0] * 8)
    likelihood = float(max_vote(logits[0], temperature).probabilities[0])
    assert likelihood == pytest.approx(9 / 10, abs=1e-3)  # Platt's target


def test_temperature_changes_probabilities_and_no_vote():
    logits = torch.tensor([[2.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
    plain, flat = max_vote(logits), max_vote(logits, 5.0)
    assert (plain.label, plain.shares.tolist()) == (flat.label, flat.shares.tolist())
    assert plain.probability > flat.probability
    expected = softmax(logits.double().numpy() / 5, axis=0).mean(axis=1)
    np.testing.assert_allclose(flat.probabilities, expected)
