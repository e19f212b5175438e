"""Multiply-accumulates of a decision, from the sizes of the recordings, before it is made."""

from functools import lru_cache

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.inference.macs import count_macs


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
        classifier, branch = self.classifier, self.classifier.branch(sense)
        x = branch.blank(height, width).to("meta")
        return count_macs(
            lambda: classifier.project(sense, branch.dense(x, classifier.level(sense)))
        )
