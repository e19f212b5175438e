"""A classifier that takes recordings one by one and decides on them in any combination.

A FusionNet computes its summand of the class scores for each trace and each photo once, however
many samples they are part of, and decides as :meth:`SurfaceClassifier.classify` does.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier, content_seed
from tex_lightning.data.recordings import Modality
from tex_lightning.decision.voting import probabilities
from tex_lightning.errors import UserError
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.perturbations.scene import Array


@dataclass(frozen=True)
class Scores:
    """What a classifier made of one recording.

    Attributes:
        recording: Trace or photo; a FusionNet draws its pairs by it.
        scores: Class scores (classes, positions) by this recording alone.
        summand: What it adds to those of a FusionNet; the same at level FC2.
    """

    recording: Array
    scores: Tensor
    summand: Tensor

    @property
    def belief(self) -> Tensor:
        """Mean class probabilities (classes,) by this recording alone, float64."""
        return probabilities(self.scores) / self.scores.shape[1]


@dataclass(frozen=True)
class Decision:
    """What became of one sample.

    Attributes:
        label: Class index; None if the classifier refused the sample.
        share: Share of the votes.
        probability: Mean probability of the label over the fragments.
        agreement: Of a FusionNet with both modalities, the probability that draws from the beliefs
            of its two parts are the same class; else None.
    """

    label: int | None
    share: float = 0.0
    probability: float = 0.0
    agreement: float | None = None


REFUSED = Decision(None)


class Evaluator:
    """Decide by what was scored of recordings.

    Args:
        classifier: In evaluation mode, as prediction runs it.
    """

    def __init__(self, classifier: SurfaceClassifier) -> None:
        self.classifier = classifier
        self.classes = classifier.card.classes
        self.fused = classifier.card.kind == "fusion"

    @torch.inference_mode()
    def score(self, recording: Array, modality: Modality) -> Scores | None:
        """Class scores of every position of a recording; None if it is refused."""
        tensor = torch.from_numpy(np.array(recording))
        try:
            if self.fused:
                return self._half(recording, tensor, modality)
            trace, photo = (tensor, None) if modality == "haptic" else (None, tensor)
            scores = self.classifier.logits(trace, photo).cpu()
        except UserError:
            return None
        return Scores(recording, scores, scores)

    def _half(self, recording: Array, tensor: Tensor, modality: Modality) -> Scores:
        network = cast(FusionNet, self.classifier.network)
        if modality == "haptic":
            features = self.classifier.haptic_positions(tensor, network.level)
            summand = network.project_haptic(features[None])[0]
        else:
            features = self.classifier.visual_positions(tensor, network.level).flatten(1)
            summand = network.project_visual(features[None])[0]
        scores = summand if network.level == "fc2" else features
        return Scores(recording, scores.cpu(), summand.cpu())

    @torch.inference_mode()
    def alone(self, scores: Scores | None) -> Decision:
        """Decide by one recording; so does a FusionNet whose other modality is missing."""
        # a FusionNet's part has no temperature of its own: `part_card`
        temperature = 1.0 if self.fused else self.classifier.card.temperature
        return REFUSED if scores is None else self._decide(scores.scores, temperature)

    @torch.inference_mode()
    def together(
        self, haptic: Scores | None, image: Scores | None, pairs: int | None = None
    ) -> Decision:
        """Decide by both recordings, over so many pairs; None takes the card's."""
        if haptic is None or image is None:
            return REFUSED
        seed = self.classifier.card.decision["seed"]
        scores = self.classifier.pair_scores(
            haptic.summand[None],
            image.summand[None],
            content_seed(seed, haptic.recording, image.recording),
            pairs,
        )
        temperature = self.classifier.card.temperature
        return self._decide(scores, temperature, float(haptic.belief @ image.belief))

    def _decide(
        self, scores: Tensor, temperature: float, agreement: float | None = None
    ) -> Decision:
        vote = self.classifier.decide(scores, temperature)
        return Decision(vote.label, float(vote.shares[vote.label]), vote.probability, agreement)
