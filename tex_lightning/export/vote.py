"""The decision of :mod:`~tex_lightning.decision.voting` as one graph, with its rule for ties."""

from typing import NamedTuple

import torch
from torch import Tensor


class TracedVote(NamedTuple):
    """See :class:`~tex_lightning.decision.voting.Vote`; ``label`` is int64 ()."""

    label: Tensor
    shares: Tensor
    probabilities: Tensor


def traced_vote(scores: Tensor, rule: str, temperature: float | Tensor) -> TracedVote:
    """Decide by class scores (classes, fragments)."""
    classes, wide = torch.arange(scores.shape[0]), scores.double()
    votes = (scores.argmax(dim=0)[None] == classes[:, None]).sum(dim=1)
    fragments = votes.sum()
    probabilities = (wide / temperature).softmax(dim=0).sum(dim=1) / fragments
    if rule == "score":
        probabilities = (wide.mean(dim=1) / temperature).softmax(dim=0)
    chosen = probabilities
    if rule == "vote":  # among those with most votes the most probable, then the first
        chosen = torch.where(votes == votes.max(), probabilities, -1.0)
    return TracedVote(chosen.argmax(), votes.float() / fragments.float(), probabilities.float())
