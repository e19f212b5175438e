"""Votes and tuples are those of the package."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.classifier import content_seed
from tex_lightning.decision.voting import RULES, random_tuples
from tex_lightning_runtime.voting import join, vote


@given(st.integers(1, 6), st.integers(1, 9), st.sampled_from(sorted(RULES)), st.booleans())
def test_votes(classes, fragments, rule, ties):
    scores = np.random.default_rng(fragments).standard_normal((classes, fragments))
    scores = (scores.round() if ties else scores).astype(np.float32)
    expected = RULES[rule](torch.from_numpy(scores), 1.5)
    best, shares, probabilities = vote(scores, rule, 1.5)
    np.testing.assert_array_equal(shares, expected.shares)
    np.testing.assert_allclose(probabilities, expected.probabilities, rtol=1e-12)
    assert probabilities[best] == pytest.approx(expected.probability)
    if not ties:  # a sum in another order may round two equal ones apart
        assert best == expected.label


@given(st.integers(0, 2**32 - 1), st.lists(st.integers(1, 3_000), min_size=2, max_size=3))
def test_tuples_are_those_of_pytorch(seed, positions):
    contents = [np.full(count, count, np.float32) for count in positions]
    tuples = random_tuples(positions, 50, content_seed(seed, *contents))
    parts = [
        np.arange(count, dtype=np.float64)[None] * 10**place
        for place, count in zip((0, 4, 8), positions, strict=False)
    ]
    expected = sum(part[:, tuples[:, index]] for index, part in enumerate(parts))
    found = join(parts, contents, {"seed": seed, "pairs": 50})
    np.testing.assert_array_equal(found, expected)


def test_a_single_sense_is_taken_row_by_row():
    scores = np.arange(24).reshape(2, 3, 4)
    np.testing.assert_array_equal(
        join([scores], [], {"seed": 0, "pairs": 5}), scores.reshape(2, 12)
    )
