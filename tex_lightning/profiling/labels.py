"""How far different ways of classifying the same recording agree."""

from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.decision.voting import max_vote
from tex_lightning.networks.windows import WindowNet, batches, dense_grid, scores

BATCH = 8  # windows that go through a network at once


def agreement(network: nn.Module, twin: WindowNet, x: Tensor, grid: Tensor) -> dict[str, float]:
    """Shares of windows that the twin gives the same label as the network does.

    Args:
        network: As trained.
        twin: Twin of ``network``.
        x: Input (1, C, H, W).
        grid: Its windows (rows, columns, C, height, width).

    Returns:
        ``label_agreement``, with the network on the window alone, and ``dense_agreement``, with
        its output for the whole input: there its layers see the neighbourhood of the window where
        the window's own pad with zeros.
    """
    twins = torch.cat([twin(batch) for batch in batches(grid, BATCH)]).argmax(1)
    parts = [scores(network, batch).flatten(1) for batch in batches(grid, BATCH)]
    alone = torch.cat(parts).argmax(1)
    dense = dense_grid(scores(network, x)).argmax(-1)[: grid.shape[0], : grid.shape[1]].flatten()
    return {
        "label_agreement": float((twins == alone).cpu().double().mean()),
        "dense_agreement": float((twins == dense).cpu().double().mean()),
    }


def flips(exact: Tensor, rough: Tensor, name: str) -> dict[str, Any]:
    """Labels that other arithmetic changes.

    Args:
        exact: Scores (classes, positions) of the network as trained, for one input.
        rough: The same, computed in another way.
        name: Name of that way, for the keys.

    Returns:
        ``flips_NAME`` of ``positions``, and ``vote_flips_NAME``, whether the vote changes.
    """
    votes = [max_vote(exact), max_vote(rough)]
    return {
        "positions": len(votes[0].fragments),
        f"flips_{name}": int((votes[0].fragments != votes[1].fragments).sum()),
        f"vote_flips_{name}": votes[0].label != votes[1].label,
    }
