"""Sequential decisions: they compute no more fragments than the label needs.

- A long trace is taken from its beginning, each time twice as many fragments, until the rest
  cannot change the vote or the mean probability is enough. Where beginnings would take longer than
  the full pass, that is done instead: on traces of a few seconds at once.
- A large photo is taken window by window in random order (:class:`StoppingRule`). A single window
  sees zeros beyond its edge where the dense pass sees the photo, so its score is not exactly the
  dense one; it is what the network was trained on. Where the windows would cost more than the dense
  pass, that is done instead.
- Of several senses the cheapest comes first, and the next cheapest is added as long as the vote of
  those that were asked is not sure enough.

Where fragments are averaged (``rule`` is not ``vote``) no majority ends a vote: a photo is taken
whole, and of the rest as much as a confident probability needs; mean scores take a trace whole.
"""

import logging
from collections.abc import Iterator, Sequence
from functools import cache

import torch
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.early_stopping import StoppingRule, is_confident
from tex_lightning.classifier.vote import Vote, max_vote, random_tuples
from tex_lightning.config import DecisionConfig, EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import Costs, accelerate, count_macs
from tex_lightning.inference.stream_classifier import StreamingClassifier
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.spectrogram import movement_start

log = logging.getLogger(__name__)
STREAMED = 3.0  # time of a multiply-accumulate here over that in a full pass; measured 2.3 to 3


def signal_stream(classifier: SurfaceClassifier, sense: str) -> StreamingClassifier | None:
    """Make a stream for a signal; for a FusionNet, of the part of its sense with its scores.

    None if there is no such part, or features or weights are such that it needs the whole signal.
    """
    try:
        return StreamingClassifier(classifier.with_senses([sense]), keep_scores=True)
    except UserError:
        return None


def growing_prefixes(trace: Tensor, stream: StreamingClassifier, costs: Costs) -> Iterator[Vote]:
    """Yield votes over longer and longer beginnings of a signal, each computed when it is needed.

    They end before the next one would bring the time of all to that of a full pass, which then
    should be done. That may be before the first.

    Args:
        trace: (axes, samples), decoded.
        stream: Computes; it is restarted.
        costs: Costs of the full pass.

    Raises:
        UserError: If there is not one fragment.
    """
    features, sense = stream.features, stream.sense
    bands, frames = sense.input_size(trace)
    sense.check_frames(frames)
    start = movement_start(trace, features.sampling_rate) if features.skip_impact else 0
    movement, begin, before = trace[:, start:], 0, 0
    budget = costs.of(sense.name, bands, frames) / STREAMED
    stream.restart(start_known=True)
    for seen in _lengths(sense, frames):
        cost = costs.of(sense.name, bands, seen)
        if stream.macs + cost - before > budget:
            return
        end, before = features.samples(seen), cost
        vote = stream.push(movement[:, begin:end])
        assert vote is not None  # every beginning has a fragment
        yield vote
        begin = end


def _lengths(sense: Sense, frames: int) -> Iterator[int]:
    """Frames of 1, 2, 4, 8 ... fragments: every push has a cost of its own."""
    fragments, stride = 1, sense.stride
    while (seen := sense.min_size[1] + (fragments - 1) * stride) < frames:
        yield seen
        fragments *= 2
    yield frames


MAX_VOTE, SEQUENTIAL = "max_vote", "sequential"
BATCH = 16  # windows computed at once


def decide(classifier: SurfaceClassifier, config: DecisionConfig) -> SurfaceClassifier:
    """Let a classifier decide as ``config`` says.

    Args:
        classifier: In evaluation mode, as it is to run.
        config: ``name`` and the thresholds.

    Raises:
        UserError: If a baseline is to decide sequentially.
    """
    if config.name == MAX_VOTE:
        return classifier
    if classifier.card.baseline:
        raise UserError(
            f"decision=sequential needs a network, and {classifier.card.title} "
            "looks at the whole recording at once; use decision=max_vote."
        )
    return SequentialClassifier(classifier, config)


def make_inference_model(
    classifier: SurfaceClassifier, engine: EngineConfig, decision: DecisionConfig
) -> SurfaceClassifier:
    """Prepare a classifier for tests and prediction: accelerated, with the configured decision."""
    fast = accelerate(classifier, engine)
    fast.card = fast.card.deciding(decision)
    return decide(fast, decision)


def needs_threshold(classifier: SurfaceClassifier) -> bool:
    """Whether a sequential decision uses a probability, as all but those on a single photo do."""
    senses = classifier.senses.values()
    return not classifier.card.baseline and not (
        len(senses) == 1 and all(sense.windowed for sense in senses)
    )


class SequentialClassifier(SurfaceClassifier):
    """A classifier that computes only the fragments that it needs; see the module.

    Args:
        classifier: Computes; its full vote is the decision that is spared.
        config: ``alpha``, and ``confidence_threshold`` unless ``calibrated`` finds one in the card.

    Attributes:
        threshold: Mean probability at which some senses, or the beginning of a trace, decide.
        counts: Whether fragments are counted, so that the rest of a vote may not matter.
    """

    def __init__(self, classifier: SurfaceClassifier, config: DecisionConfig) -> None:
        nn.Module.__init__(self)
        self.card = classifier.card
        self.full = classifier
        self.costs = Costs(classifier.card)
        self.rule = StoppingRule(config.alpha, len(classifier.card.classes))
        self.counts = classifier.card.rule == "vote"
        self.densities: dict[str, float] = {}
        chosen = self.card.calibration if config.calibrated else {}
        self.threshold = chosen.get("confidence_threshold", config.confidence_threshold)
        by_score = classifier.card.rule == "score"  # a stream keeps votes and probabilities
        self.streams = {
            name: None if sense.windowed or by_score else signal_stream(classifier, name)
            for name, sense in classifier.senses.items()
        }

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.full.device

    def logits(self, **recordings: Tensor) -> Tensor:
        """Class scores of all fragments; see the base class."""
        return self.full.logits(**recordings)

    @torch.inference_mode()
    def classify(self, **recordings: Tensor) -> Vote:
        """Decide on one sample; ``relative_macs`` is the share of the arithmetic done."""
        self.require(recordings)
        senses = self.full.senses
        if len(senses) > 1:
            return self._several(senses, recordings)
        (sense,) = senses.values()
        recording = recordings[sense.modality]
        if not sense.windowed:
            return self._trace(sense, recording)
        return self._photo(sense, recording) if self.counts else self.full.classify(**recordings)

    def _trace(self, sense: Sense, trace: Tensor) -> Vote:
        """Take more and more of a trace, nothing twice."""
        stream = self.streams[sense.name]
        if stream is None:
            return self.full.classify(**{sense.modality: trace})
        bands, frames = sense.input_size(trace)
        full = self.costs.of(sense.name, bands, frames)
        for vote in growing_prefixes(trace, stream, self.costs):
            certain = self.counts and stream.certain(frames)
            if is_confident(vote.probability, self.threshold) or certain:
                return _spent(vote, stream.macs, full)
        if not stream.macs:
            _say_nothing_saved()
        return _spent(self.full.classify(**{sense.modality: trace}), stream.macs + full, full)

    def _photo(self, sense: Sense, photo: Tensor) -> Vote:
        """Vote over the positions of a photo in random order."""
        sense.check(photo)
        rows, columns = sense.grid(photo)
        generator = torch.Generator().manual_seed(self.full.seed(**{sense.modality: photo}))
        order = torch.randperm(rows * columns, generator=generator)
        none = torch.zeros(len(self.card.classes), rows * columns, device=self.device)
        return self._draw(sense, photo, none, order, 0)

    def _several(self, senses: dict[str, Sense], recordings: dict[str, Tensor]) -> Vote:
        """Use one sense after another, the cheapest first; a photo that comes last by windows."""
        own = {name: recordings[sense.modality] for name, sense in senses.items()}
        costs = {name: self._cost(sense, own[name]) for name, sense in senses.items()}
        full, (first, *others) = sum(costs.values()), sorted(costs, key=costs.__getitem__)
        partial_logits, vote, spent = self._listen(senses[first], own[first], costs[first])
        if is_confident(vote.probability, self.threshold):
            return _spent(vote, spent, full)
        partials, seed = {first: partial_logits}, self.full.seed(**recordings)
        for name in others:
            if name == others[-1] and senses[name].windowed and self.counts:
                return self._last_photo(name, own[name], partials, seed, spent, full)
            partials[name] = self.full.partial_logits(name, own[name])
            spent += costs[name]
            if name != others[-1]:
                vote = self._tuples_vote(partials, seed, 1.0)
                if is_confident(vote.probability, self.threshold):
                    return _spent(vote, spent, full)
        return _spent(self._tuples_vote(partials, seed, self.card.temperature), spent, full)

    def _cost(self, sense: Sense, recording: Tensor) -> int:
        """Multiply-accumulates of one sense, of a recording that is large enough.

        Of a network that does not say what it makes of a recording they are counted on the first
        one, and taken as proportional to its size for others: computing tells, but costs as much.
        """
        if sense.knows_min_size:
            sense.check(recording)
            return self.costs.of(sense.name, *sense.input_size(recording))
        if sense.name not in self.densities:
            macs = count_macs(lambda: self.full.partial_logits(sense.name, recording))
            self.densities[sense.name] = macs / recording.numel()
        return max(1, round(self.densities[sense.name] * recording.numel()))

    def _tuples_vote(self, partials: dict[str, Tensor], seed: int, temperature: float) -> Vote:
        """The vote of the senses used so far; the vote of all senses is the full one."""
        asked = [partials[name] for name in self.full.senses if name in partials]
        tuples = self._tuples([each.shape[1] for each in asked], seed)
        drawn = [each[:, tuples[:, place]] for place, each in enumerate(asked)]
        return self.full.decide(_sum(drawn), temperature)

    def _last_photo(
        self,
        last: str,
        photo: Tensor,
        partials: dict[str, Tensor],
        seed: int,
        spent: int,
        full: int,
    ) -> Vote:
        """Draw the tuples of the full vote, and compute the windows of the photo that they need."""
        senses = self.full.senses
        counts = [
            partials[name].shape[1] if name in partials else _count(sense, photo)
            for name, sense in senses.items()
        ]
        places = dict(zip(senses, self._tuples(counts, seed).T, strict=True))
        known = [partials[name][:, places[name]] for name in senses if name in partials]
        order = places[last].cpu()
        return self._draw(senses[last], photo, _sum(known), order, spent, full)

    def _tuples(self, counts: Sequence[int], seed: int) -> Tensor:
        """Positions (tuples, senses) that are voted over, on the device of the scores."""
        return random_tuples(counts, self.card.decision["pairs"], seed).to(self.device)

    def _listen(self, sense: Sense, recording: Tensor, cost: int) -> tuple[Tensor, Vote, int]:
        """Compute partial logits (classes, positions), vote and cost of one sense until confident.

        A confident vote leaves out the rest of a signal, in the partial logits too.
        """
        name, stream, spent = sense.name, self.streams[sense.name], 0
        if stream is not None:
            for vote in growing_prefixes(recording, stream, self.costs):
                if is_confident(vote.probability, self.threshold):
                    own = (
                        self.full.level(name) == "fc2"
                    )  # the stream's scores are the partial_logits then
                    scores = stream.scores if own else self.full.project(name, stream.scores)
                    return scores, vote, stream.macs
            spent = stream.macs
        scores = self.full.partial_logits(name, recording)
        return scores, self.full.decide(scores, 1.0), spent + cost

    def _draw(
        self,
        sense: Sense,
        photo: Tensor,
        others: Tensor,
        order: Tensor,
        before: int,
        full: int | None = None,
    ) -> Vote:
        """Vote over fragments one after another, computing the windows that they need.

        Args:
            sense: Sense of the photo.
            photo: Decoded.
            others: (classes, fragments) what is added to the photo's score of each fragment.
            order: (fragments,) position of each in the photo, row by row.
            before: Multiply-accumulates done before.
            full: Those of the full decision; None takes the photo's.
        """
        dense = self.costs.of(sense.name, *sense.input_size(photo))
        one = self.costs.of(sense.name, *sense.window_size)
        full, spent = full or dense, before
        table = others.new_empty(len(others), _count(sense, photo))
        known = torch.zeros(table.shape[1], dtype=torch.bool)
        votes, drawn = [0] * len(others), 0
        while not self.rule.decided(votes, len(order) - drawn):
            more = self.rule.least_more(votes, len(order) - drawn)
            asked = torch.unique(order[drawn : drawn + more])
            fresh = asked[~known[asked]]
            if spent - before + len(fresh) * one > dense:
                table, spent = self.full.partial_logits(sense.name, photo), spent + dense
                drawn = len(order)
                break
            table[:, fresh.to(table.device)] = self._windows(sense, photo, fresh)
            known[fresh], spent = True, spent + len(fresh) * one
            new = slice(drawn, drawn + more)
            labels = (others[:, new] + table[:, order[new].to(table.device)]).argmax(dim=0)
            counts = torch.bincount(labels, minlength=len(votes)).tolist()
            votes = [old + count for old, count in zip(votes, counts, strict=True)]
            drawn += more
        logits = others[:, :drawn] + table[:, order[:drawn].to(table.device)]
        return _spent(max_vote(logits, self.card.temperature), spent, full)

    def _windows(self, sense: Sense, photo: Tensor, places: Tensor) -> Tensor:
        """Scores (classes, places) of single windows; those at the far edge lie inside."""
        columns, side = sense.grid(photo)[1], torch.tensor(sense.window_size)
        corners = torch.stack((places // columns, places % columns), dim=1) * sense.stride
        corners = corners.minimum((torch.tensor(sense.input_size(photo)) - side).clamp(min=0))
        level = self.full.level(sense.name)
        found = [sense.windows(photo, part, level) for part in torch.split(corners, BATCH)]
        return self.full.project(sense.name, torch.cat(found, dim=1))


def _count(sense: Sense, recording: Tensor) -> int:
    """Positions that a recording gives."""
    rows, columns = sense.grid(recording)
    return rows * columns


def _sum(partials: Sequence[Tensor]) -> Tensor:
    """Their sum, in order."""
    total, *others = partials
    for partial_logits in others:
        total = total + partial_logits
    return total


@cache
def _say_nothing_saved() -> None:
    """Once, however many traces there are."""
    log.info("decision=sequential saves nothing on traces as short as this: all is computed.")


def _spent(vote: Vote, macs: int, full: int) -> Vote:
    """The vote with its share of the full decision's arithmetic."""
    return Vote(vote.label, vote.shares, vote.fragments, vote.probabilities, macs / full)
