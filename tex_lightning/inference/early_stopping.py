"""Sequential decisions, which stop as soon as the label is certain enough.

- A long trace is classified by its beginning: first by one fragment, then by a beginning of twice
  the length, until the mean probability reaches ``decision.confidence_threshold``. If beginnings
  would cost more than half of the full pass, the whole trace is classified; a trace of a few
  seconds therefore always is.
- Of several senses the cheapest is computed first. The next cheapest is added while the vote of
  those before is not confident.
- A sample whose novelty exceeds the threshold of ``decision.unknown`` is classified as a whole. So
  early stopping calls no more known recordings unknown than the full decision does.

A single photo, and a trace that is decided by its mean score, are always classified as a whole.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier, join_novelties
from tex_lightning.classifier.vote import RULES, Decider, Vote
from tex_lightning.config import DecisionConfig, EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate, count_macs, empty_classifier, input_macs
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.movement import movement_start
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

SEQUENTIAL = "sequential"
MAX_WASTE = 0.5  # of the full pass, that undecided beginnings of a trace may cost


def make_inference_model(
    classifier: SurfaceClassifier, engine: EngineConfig, decision: DecisionConfig
) -> Decider:
    """Prepare a classifier for tests: accelerated, with the configured decision."""
    fast = accelerate(classifier, engine)
    fast.card = fast.card.deciding(decision)
    return make_decider(fast, decision)


def make_decider(
    full: SurfaceClassifier, decision: DecisionConfig
) -> "SurfaceClassifier | SequentialDecision":
    """Return the decider that uses a classifier: itself, or a sequential decision by it.

    The classifier is in evaluation mode, accelerated or not.

    Raises:
        UserError: If a baseline is to decide sequentially.
    """
    if decision.name != SEQUENTIAL:
        return full
    if full.card.baseline:
        raise UserError(
            f"decision=sequential needs a network, and {full.card.title} looks at the whole "
            "recording at once; use decision=max_vote."
        )
    return SequentialDecision(full, decision, empty_classifier(full.card))


def is_local(sense: Sense) -> bool:
    """Return whether a beginning of a trace gives the same positions as the whole trace."""
    features = sense.features
    local = isinstance(features, SpectrogramFeatures) and (
        (features.axes, features.normalisation) == ("frame", "standard")
    )
    return local and sense.geometry is not None


class SequentialDecision:
    """A decider that stops as soon as it is confident; see the module.

    ``full`` computes the scores, and the arithmetic of each sense is counted with ``empty``
    (:func:`~.engine.empty_classifier`). A ``confidence_threshold`` of 1 is never reached.
    """

    def __init__(
        self, full: SurfaceClassifier, config: DecisionConfig, empty: SurfaceClassifier
    ) -> None:
        self.card, self.full, self.config, self.empty = full.card, full, config, empty
        self.macs = lru_cache(partial(input_macs, empty))
        self.densities: dict[str, float] = {}  # multiply-accumulates for each number of an input
        self.threshold = config.confidence_threshold
        self.novelty_limits: dict[tuple[str, ...], float | None] = {}

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.full.device

    def with_senses(self, senses: Sequence[str]) -> "SequentialDecision":
        """Return the decider by some of the senses, which shares the networks of this one."""
        part, empty = self.full.with_senses(senses), self.empty.with_senses(senses)
        return SequentialDecision(part, self.config, empty)

    @torch.inference_mode()
    def classify(self, **recordings: Tensor) -> Vote:
        """Decide on one sample; ``relative_macs`` is the share of the arithmetic done."""
        self.full.require(recordings)
        senses = self.full.senses
        if len(senses) > 1:
            return self._several(senses, recordings)
        (sense,) = senses.values()
        if is_local(sense) and not RULES[self.card.rule].by_mean_score:
            return self._trace(sense, recordings[sense.modality])
        return self.full.classify(**recordings)

    def _trace(self, sense: Sense, trace: Tensor) -> Vote:
        """Classify longer and longer beginnings of a trace until the vote is confident."""
        features: Any = sense.features
        bands, frames = sense.input_size(trace)
        sense.check_input(bands, frames)
        start = movement_start(trace, features.sampling_rate) if features.skip_impact else 0
        full, spent, seen = self.macs(sense.name, bands, frames), 0, sense.min_size[1]
        while seen < frames:
            cost = self.macs(sense.name, bands, seen)
            if spent + cost > MAX_WASTE * full:
                break
            spent += cost
            beginning = trace[:, : start + features.samples(seen)]
            vote = self.full.classify(**{sense.modality: beginning})
            if self._suffices(vote, [sense.name]):
                return replace(vote, relative_macs=spent / full)
            seen *= 2
        vote = self.full.classify(**{sense.modality: trace})
        return replace(vote, relative_macs=(spent + full) / full)

    def _several(self, senses: Mapping[str, Sense], recordings: dict[str, Tensor]) -> Vote:
        """Classify with one sense after another, the cheapest first."""
        inputs = {name: recordings[sense.modality] for name, sense in senses.items()}
        costs = {name: self._cost(sense, inputs[name]) for name, sense in senses.items()}
        seed, outputs, spent = self.full.seed(**recordings), dict[str, SenseOutput](), 0
        for name in sorted(costs, key=costs.__getitem__):
            outputs[name] = self.full.sense_output(name, inputs[name])
            spent += costs[name]
            if len(outputs) == len(senses):
                break
            asked = [name for name in senses if name in outputs]
            partials = [outputs[name].partial_logits for name in asked]
            novelty = join_novelties([outputs[name] for name in asked])
            vote = self.full.decide(self.full.fuse(partials, seed), 1.0)
            known = None if novelty is None else float(novelty)
            if self._suffices(replace(vote, novelty=known), asked):
                looked_at = tuple(dict.fromkeys(senses[name].modality for name in asked))
                # its novelty is not on the scale of others, to which all senses add
                return replace(
                    vote, relative_macs=spent / sum(costs.values()), modalities=looked_at
                )
        return self.full.vote(outputs, seed)

    def _suffices(self, vote: Vote, asked: Sequence[str]) -> bool:
        """Return whether a vote is confident, and not more novel than these senses allow."""
        names = tuple(asked)
        if names not in self.novelty_limits:
            self.novelty_limits[names] = self.card.of(names).unknown_above
        limit = self.novelty_limits[names]
        novel = limit is not None and vote.novelty is not None and vote.novelty > limit
        confident = vote.probability >= self.threshold and self.threshold < 1
        return confident and not novel

    def _cost(self, sense: Sense, recording: Tensor) -> int:
        """Return the multiply-accumulates of one sense for a recording.

        If they do not follow from the size of the recording, they are counted on the first one and
        taken as proportional to the size: to count them takes as long as to classify.
        """
        if sense.knows_min_size:
            sense.check(recording)
            return self.macs(sense.name, *sense.input_size(recording))
        if sense.name not in self.densities:
            macs = count_macs(lambda: self.full.partial_logits(sense.name, recording))
            self.densities[sense.name] = macs / recording.numel()
        return max(1, round(self.densities[sense.name] * recording.numel()))
