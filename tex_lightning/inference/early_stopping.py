"""Decisions that look at no more than the label needs, and compute no more than they look at.

- A long trace is taken from its beginning, each time twice as many fragments, until the rest
  cannot change the vote or the mean probability is enough. Where beginnings would take longer than
  the full pass, that is done instead: on traces of a few seconds at once.
- A large photo is taken window by window in random order (:class:`StoppingRule`). A single window
  sees zeros beyond its edge where the dense pass sees the photo, so its score is not exactly the
  dense one; it is what the network was trained on. Where the windows would cost more than the dense
  pass, that is done instead.
- Of two modalities the cheaper one comes first, and the other one if that is not sure enough.
"""

import logging
from collections.abc import Callable
from functools import cache
from typing import cast

import torch
from torch import Tensor, nn

from tex_lightning.classifier import SurfaceClassifier, check_frames, check_side
from tex_lightning.config import DecisionConfig, EngineConfig
from tex_lightning.decision.early_stopping import StoppingRule, is_confident
from tex_lightning.decision.voting import Vote, max_vote, random_pairs
from tex_lightning.errors import UserError
from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.inference.beginnings import beginnings, haptic_stream
from tex_lightning.inference.costs import Costs
from tex_lightning.inference.engine import accelerate
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.networks.windows import window_size

log = logging.getLogger(__name__)

MAX_VOTE, SEQUENTIAL = "max_vote", "sequential"
BATCH = 16  # windows computed at once


def decide(classifier: SurfaceClassifier, config: DecisionConfig) -> SurfaceClassifier:
    """Let a classifier decide as ``config`` says.

    Args:
        classifier: In evaluation mode, as it is to run.
        config: ``name`` and the thresholds.

    Raises:
        UserError: If a baseline, or a checkpoint with ``rule=mean``, is to decide sequentially.
    """
    if config.name == MAX_VOTE:
        return classifier
    if classifier.card.baseline:
        raise UserError(
            f"decision=sequential needs a network, and {classifier.card.title} "
            "looks at the whole recording at once; use decision=max_vote."
        )
    if classifier.card.rule != "vote":
        raise UserError(
            "decision=sequential counts votes, and this checkpoint decides by decision.rule=mean, "
            "which does not; use decision=max_vote or decision.rule=vote."
        )
    return SequentialClassifier(classifier, config)


def prepare(
    classifier: SurfaceClassifier, engine: EngineConfig, decision: DecisionConfig
) -> SurfaceClassifier:
    """A classifier as testing and prediction run it: accelerated, and deciding as configured."""
    fast = accelerate(classifier, engine)
    fast.card = fast.card.deciding(decision)
    return decide(fast, decision)


class SequentialClassifier(SurfaceClassifier):
    """A classifier that computes the fragments it asks for; see the module.

    Args:
        classifier: Computes; its full vote is the decision that is spared.
        config: ``alpha``, and ``confidence_threshold`` unless ``calibrated`` finds one in the card.

    Attributes:
        threshold: Mean probability at which one modality, or the beginning of a trace, decides.
    """

    def __init__(self, classifier: SurfaceClassifier, config: DecisionConfig) -> None:
        nn.Module.__init__(self)
        self.card = classifier.card
        self.full = classifier
        self.costs = Costs(classifier.card)
        self.rule = StoppingRule(config.alpha, len(classifier.card.classes))
        chosen = self.card.calibration if config.calibrated else {}
        self.threshold = chosen.get("confidence_threshold", config.confidence_threshold)
        self.stream = haptic_stream(classifier)

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.full.device

    def logits(self, trace: Tensor | None = None, photo: Tensor | None = None) -> Tensor:
        """Class scores of all fragments; see the base class."""
        return self.full.logits(trace, photo)

    @torch.inference_mode()
    def classify(self, trace: Tensor | None = None, photo: Tensor | None = None) -> Vote:
        """Decide on one sample; ``relative_macs`` is the share of the arithmetic done."""
        self._require(trace, photo)
        if self.card.kind == "haptic":
            return self._trace(cast(Tensor, trace))
        if self.card.kind == "visual":
            return self._photo(cast(Tensor, photo))
        return self._both(cast(Tensor, trace), cast(Tensor, photo))

    def _trace(self, trace: Tensor) -> Vote:
        """Take more and more of a trace, nothing twice."""
        if self.stream is None:
            return self.full.classify(trace)
        frames = cast(HapticFeatures, self.full.haptic_features).count_frames(trace)
        full = self.costs.haptic(frames)
        for vote in beginnings(trace, frames, self.stream, self.costs):
            if is_confident(vote.probability, self.threshold) or self.stream.certain(frames):
                return _spent(vote, self.stream.macs, full)
        if not self.stream.macs:
            _say_nothing_saved()
        return _spent(self.full.classify(trace), self.stream.macs + full, full)

    def _photo(self, photo: Tensor) -> Vote:
        """Vote over the positions of VisualNet in random order."""
        check_side(photo.shape[0], photo.shape[1], self.full.min_side)
        count = self._positions(photo)
        generator = torch.Generator().manual_seed(self.full.seed(photo))
        order = torch.randperm(count, generator=generator)
        none = torch.zeros(len(self.card.classes), count, device=self.device)
        return self._draw(photo, none, order, 0)

    def _both(self, trace: Tensor, photo: Tensor) -> Vote:
        """Ask the cheaper modality, then the pairs of both."""
        check_side(photo.shape[0], photo.shape[1], self.full.min_side)
        frames = cast(HapticFeatures, self.full.haptic_features).count_frames(trace)
        check_frames(frames, cast(HapticFeatures, self.full.haptic_features))
        visual = self.costs.visual(photo.shape[0], photo.shape[1])
        full = visual + self.costs.haptic(frames)
        if visual < full - visual:
            table = self._dense(photo)
            vote = max_vote(table)  # the temperature is that of the joined scores
            if is_confident(vote.probability, self.threshold):
                return _spent(vote, visual, full)
            scores = self._haptic_summand(trace)
            pairs = self._pairs(trace, photo, scores)
            joined = scores[:, pairs[:, 0]] + table[:, pairs[:, 1]]
            return max_vote(joined, self.card.temperature)
        scores, vote, spent = self._listen(trace, frames)
        if is_confident(vote.probability, self.threshold):
            return _spent(vote, spent, full)
        pairs = self._pairs(trace, photo, scores)
        return self._draw(photo, scores[:, pairs[:, 0]], pairs[:, 1].cpu(), spent)

    def _listen(self, trace: Tensor, frames: int) -> tuple[Tensor, Vote, int]:
        """The haptic summand (classes, L) of a FusionNet, its vote and its cost, until it is sure.

        Where it is sure the rest of the trace is left out, of the summand too.
        """
        if self.stream is None:
            scores = self._haptic_summand(trace)
            return scores, max_vote(scores), self.costs.haptic(frames)
        for vote in beginnings(trace, frames, self.stream, self.costs):
            if is_confident(vote.probability, self.threshold):
                scores, network = self.stream.scores, cast(FusionNet, self.full.network)
                if network.level == "fc3":
                    scores = network.project_haptic(scores[None])[0]
                return scores, vote, self.stream.macs
        scores = self._haptic_summand(trace)
        return scores, max_vote(scores), self.stream.macs + self.costs.haptic(frames)

    def _haptic_summand(self, trace: Tensor) -> Tensor:
        network = cast(FusionNet, self.full.network)
        return network.project_haptic(self.full.haptic_positions(trace, network.level)[None])[0]

    def _pairs(self, trace: Tensor, photo: Tensor, scores: Tensor) -> Tensor:
        """The pairs of the full vote, on the device of the scores."""
        seed, count = self.full.seed(trace, photo), self.card.decision["pairs"]
        pairs = random_pairs(scores.shape[1], self._positions(photo), count, seed)
        return pairs.to(scores.device)

    def _draw(self, photo: Tensor, others: Tensor, order: Tensor, before: int) -> Vote:
        """Vote over fragments one after another, computing the windows that they need.

        Args:
            photo: The decoded photo.
            others: (classes, fragments) what is added to the visual score of each fragment.
            order: (fragments,) position of each in the photo, row by row.
            before: Multiply-accumulates done before.
        """
        dense, one = self.costs.visual(photo.shape[0], photo.shape[1]), self._window_cost()
        full, spent = before + dense, before
        table = others.new_empty(len(others), self._positions(photo))
        known = torch.zeros(table.shape[1], dtype=torch.bool)
        votes, drawn = [0] * len(others), 0
        while not self.rule.decided(votes, len(order) - drawn):
            more = self.rule.least_more(votes, len(order) - drawn)
            asked = torch.unique(order[drawn : drawn + more])
            fresh = asked[~known[asked]]
            if spent - before + len(fresh) * one > dense:
                table, spent = self._dense(photo), spent + dense
                drawn = len(order)
                break
            table[:, fresh.to(table.device)] = self._windows(photo, fresh)
            known[fresh], spent = True, spent + len(fresh) * one
            new = slice(drawn, drawn + more)
            labels = (others[:, new] + table[:, order[new].to(table.device)]).argmax(dim=0)
            counts = torch.bincount(labels, minlength=len(votes)).tolist()
            votes = [old + count for old, count in zip(votes, counts, strict=True)]
            drawn += more
        logits = others[:, :drawn] + table[:, order[:drawn].to(table.device)]
        return _spent(max_vote(logits, self.card.temperature), spent, full)

    def _positions(self, photo: Tensor) -> int:
        rows, columns = self._visual_network.output_size(photo.shape[0], photo.shape[1])
        return rows * columns

    @property
    def _visual_network(self) -> VisualNet:
        network = self.full.network
        return network.visual if isinstance(network, FusionNet) else cast(VisualNet, network)

    def _window_cost(self) -> int:
        return self.costs.visual(*window_size(self._visual_network))

    def _dense(self, photo: Tensor) -> Tensor:
        """Visual scores (classes, positions) of the whole photo."""
        network = self.full.network
        if isinstance(network, FusionNet):
            features = self.full.visual_positions(photo, network.level).flatten(1)
            return network.project_visual(features[None])[0]
        return self.full.visual_positions(photo, "fc3").flatten(1)

    def _windows(self, photo: Tensor, places: Tensor) -> Tensor:
        """Visual scores (classes, places) of single windows; those at the far edge lie inside."""
        network, visual = self.full.network, self._visual_network
        columns = visual.output_size(photo.shape[0], photo.shape[1])[1]
        side = torch.tensor(window_size(visual))
        corners = torch.stack((places // columns, places % columns), dim=1) * visual.stride
        corners = corners.minimum((torch.tensor(photo.shape[:2]) - side).clamp(min=0))
        score: Callable[[Tensor], Tensor]
        if isinstance(network, FusionNet):
            level, score = network.level, lambda x: network.project_visual(x[None])[0]
        else:
            level, score = "fc3", lambda x: x
        return torch.cat(
            [
                score(self.full.visual_windows(photo, part, level))
                for part in torch.split(corners, BATCH)
            ],
            dim=1,
        )


@cache
def _say_nothing_saved() -> None:
    """Once, however many traces there are."""
    log.info("decision=sequential saves nothing on traces as short as this: all is computed.")


def _spent(vote: Vote, macs: int, full: int) -> Vote:
    """The vote with its share of the full decision's arithmetic."""
    return Vote(vote.label, vote.shares, vote.fragments, vote.probabilities, macs / full)
