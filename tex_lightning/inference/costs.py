"""Multiply-accumulates of a decision, from the sizes of the recordings, before it is made."""

from collections.abc import Callable
from functools import lru_cache

import torch
from torch.utils.flop_counter import FlopCounterMode

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier


def count_macs(function: Callable[[], object]) -> int:
    """Multiply-accumulates of the convolutions and matrix products that a function runs.

    PyTorch counts two operations for each; normalisation, pooling and Fourier transforms are not
    counted.
    """
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        function()
    return int(counter.get_total_flops()) // 2


class Costs:
    """Multiply-accumulates of a card's network, counted on tensors that hold nothing.

    Convolutions and matrix products are counted; features, pooling and normalisation are not.

    Args:
        card: Card of one of this package's networks.

    Attributes:
        of: Multiply-accumulates of one sense with its part of a fusion layer, by its name and the
            height and width of its input.
    """

    def __init__(self, card: Card) -> None:
        self.classifier = SurfaceClassifier(card).eval().to("meta")
        self.of = lru_cache(self._of)

    def _of(self, sense: str, height: int, width: int) -> int:
        classifier, branch = self.classifier, self.classifier.sense(sense)
        x = branch.blank(height, width).to("meta")
        return count_macs(
            lambda: classifier.project(sense, branch.dense(x, classifier.level(sense)))
        )
