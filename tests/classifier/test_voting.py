import statistics

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.special import softmax

import tex_lightning as tl
from tex_lightning.classifier.vote import RULES, random_tuples
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import make_prediction
from tex_lightning.networks.temperature import fit_temperature
from tex_lightning_runtime.quality import Quality

LOGITS = arrays(
    np.float32,
    st.tuples(st.integers(2, 6), st.integers(1, 30)),
    elements=st.integers(-4, 4).map(float),
)
max_vote, mean_vote, score_vote = RULES["vote"], RULES["mean"], RULES["score"]


@pytest.mark.parametrize("rule", [max_vote, mean_vote, score_vote])
@pytest.mark.parametrize("wrong", [torch.nan, torch.inf])
def test_scores_that_are_not_finite_are_no_vote(rule, wrong):
    scores = torch.zeros(3, 4)
    scores[1, 2] = wrong
    with pytest.raises(UserError, match="NaN or infinite, so there is no decision"):
        rule(scores)


@given(LOGITS)
def test_the_winner_is_a_mode_of_the_fragments(logits):
    vote = max_vote(torch.from_numpy(logits))
    assert vote.label in statistics.multimode(logits.argmax(axis=0).tolist())
    assert vote.shares.sum().item() == pytest.approx(1)


def test_ties_go_to_the_larger_mean_probability_then_the_lower_index():
    surer_second = torch.tensor([[2.0, 0.0], [0.0, 5.0]])
    assert max_vote(surer_second).label == 1
    equal = torch.tensor([[1.0, 0.0], [0.0, 1.0]])
    assert max_vote(equal).label == 0


@pytest.mark.parametrize("positions", [[24], [2, 3, 4], [3, 1, 2, 4]])
def test_tuples_of_any_number_of_senses_are_uniform(positions):
    tuples = random_tuples(positions, 24_000, seed=7)
    assert tuples.shape == (24_000, len(positions))
    cells = np.ravel_multi_index(tuples.numpy().T, positions)
    counts = np.bincount(cells, minlength=24)
    assert ((counts - 1000) ** 2 / 1000).sum() < 49.7


def test_mean_vote_follows_the_sure_fragments():
    """Two fragments lean to the first class, one is certain of the second."""
    logits = torch.tensor([[0.6, 0.6, 0.01], [0.4, 0.4, 0.99]]).log()
    assert max_vote(logits).label == 0
    vote = mean_vote(logits)
    assert vote.label == 1
    torch.testing.assert_close(vote.probabilities.float(), torch.tensor([1.21, 1.79]) / 3)


def test_score_vote_is_the_geometric_mean_of_the_fragments():
    """Many that lean one way are surer together than any of them is."""
    each = torch.tensor([[0.6, 0.5, 0.7], [0.4, 0.5, 0.3]], dtype=torch.float64)
    vote = score_vote(each.log())
    product = each.prod(dim=1) ** (1 / 3)
    torch.testing.assert_close(vote.probabilities, product / product.sum())
    assert vote.label == 0
    sharp = score_vote(each.log(), temperature=1 / 3).probabilities
    torch.testing.assert_close(sharp, product**3 / (product**3).sum())


def test_doubt_spreads_votes_and_probabilities_and_keeps_the_label():
    vote = max_vote(torch.tensor([[9.0, 9.0], [0.0, 0.0], [0.0, 0.0], [0.0, 0.0]]))
    half = vote.doubted(0.5)
    assert half.label == vote.label == 0
    assert half.shares.tolist() == [0.625, 0.125, 0.125, 0.125]
    assert float(half.probabilities.sum()) == pytest.approx(1)
    assert vote.doubted(1.0).probability == pytest.approx(0.25)
    assert torch.equal(vote.doubted(0.0).shares, vote.shares)


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


@pytest.mark.parametrize("rule", [max_vote, mean_vote, score_vote])
def test_label_confidence_and_order_agree_whatever_decides(rule, bands):
    """Of a tie, of votes that the probabilities contradict, and of a doubtful recording."""
    card = tl.load(bands).classifier.card
    torch.manual_seed(0)
    for number in range(60):
        logits = torch.randn(3, 1 + number % 7) * 10 ** (number % 3 - 1)
        quality = Quality(("It is doubtful.",) * (number % 2), empty=False)
        found = make_prediction(rule(logits), card, quality, 3, 0.0)
        shares = [each["share"] for each in found.top_k]
        assert (found.top_k[0]["label"], shares[0]) == (found.label, found.confidence)
        assert shares == sorted(shares, reverse=True)
        if rule is not max_vote:
            assert found.confidence == found.probability == max(found.probabilities.values())
