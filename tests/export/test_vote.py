"""The decision as a graph, against that of the classifier, ties included."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.decision.voting import RULES
from tex_lightning.export.vote import traced_vote


@pytest.mark.parametrize("rule", sorted(RULES))
@given(
    scores=st.lists(st.lists(st.integers(-2, 2), min_size=3, max_size=3), min_size=1, max_size=6),
    temperature=st.sampled_from([0.5, 1.0, 3.0]),
)
def test_label_shares_and_probabilities_are_the_same(rule, scores, temperature):
    logits = torch.tensor(scores).float().T
    expected, found = RULES[rule](logits, temperature), traced_vote(logits, rule, temperature)
    assert int(found.label) == expected.label
    torch.testing.assert_close(found.shares, expected.shares)
    torch.testing.assert_close(found.probabilities, expected.probabilities.float())
