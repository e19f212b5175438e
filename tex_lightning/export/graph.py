"""A trained classifier as one traceable module from decoded recordings to a label.

The senses of a FusionNet are joined in one graph, in which some may be absent, and the decision is
that of :mod:`~tex_lightning.classifier.vote`, with its rule for ties.
"""

import math
from collections.abc import Sequence
from copy import deepcopy
from inspect import Parameter, Signature
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, pad

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier, class_scores
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning.export.layers import exportable
from tex_lightning.export.signals import SpectrogramGraph, promise, signal_graph
from tex_lightning.senses.base import Sense


class Part(NamedTuple):
    """The outputs of one sense; an absent one has no positions, and its numbers are 0.

    Attributes:
        partial_logits: Class scores (classes, positions) that it adds to those of the others.
        alone: Those (classes, positions) by which it decides where all others are absent.
        positions: How many there are, int64 ().
        novelty: (); None where it is not known.
    """

    partial_logits: Tensor
    alone: Tensor
    positions: Tensor
    novelty: Tensor | None

    @classmethod
    def of(cls, partial_logits: Tensor, alone: Tensor, novelty: Tensor | None) -> "Part":
        """Make a part, with the number of its positions."""
        positions = torch.scalar_tensor(alone.shape[1], dtype=torch.int64)
        return cls(partial_logits, alone, positions, novelty)

    def named(self, sense: str) -> dict[str, Tensor]:
        """The fields that are present, by the names of :func:`names`."""
        every = zip(names(sense), self, strict=True)
        return {name: each for name, each in every if each is not None}


def names(sense: str) -> list[str]:
    """Names of the fields of a :class:`Part` among all tensors of a graph."""
    return [f"{sense}/{field}" for field in Part._fields]


def joined(parts: list[Part], draws: Tensor) -> tuple[Tensor, Tensor]:
    """Class scores (classes, fragments), and which senses are there, bool (senses,).

    They are those of :meth:`.SurfaceClassifier.with_senses` of the senses that are there: sums at
    random tuples of positions, or of a single sense those of its positions.

    Args:
        parts: Parts of all senses, in order.
        draws: int64 (K, senses); modulo the number of positions each word is a position. The first
            column is for the first sense that is there, the next for the next.
    """
    positions = torch.stack([part.positions for part in parts])
    present = positions > 0
    columns = (present.cumsum(0) - 1).clamp(min=0)
    total, *others = (_drawn(each, draws, columns[i]) for i, each in enumerate(parts))
    for each in others:
        total = total + each
    tuples = torch.scalar_tensor(draws.shape[0], dtype=torch.int64)
    single = present.sum() == 1
    every = torch.cat((total, *(part.alone for part in parts)), dim=1)
    begin = torch.where(single, tuples, 0)
    count: int = torch.where(single, positions.sum(), tuples).item()  # type: ignore[assignment]
    promise(count >= 1)
    return every.index_select(1, begin + torch.arange(count)), present


def _drawn(part: Part, draws: Tensor, column: Tensor) -> Tensor:
    """Summands (classes, K) at random positions; zeros of an absent sense."""
    words = draws.index_select(1, column[None])[:, 0]
    places = torch.remainder(words, part.positions.clamp(min=1))
    return pad(part.partial_logits, (0, 1)).index_select(1, places)


def is_unknown(card: Card, novelty: Tensor, present: Tensor) -> Tensor:
    """Whether the novelty () of a sample that has some senses (senses,) is too large; bool ()."""
    above = [math.inf, *thresholds(card).values()]
    which = (present * 2 ** torch.arange(len(card.sense_names))).sum()
    return novelty.double() > torch.tensor(above, dtype=torch.float64)[which]


def thresholds(card: Card) -> dict[str, float | None]:
    """The novelty above which a sample is unknown, by the senses it has, as ``haptic+visual``.

    They are in the order of the numbers whose bit i says that sense i is there, from 1 on.
    """
    sets = [
        [name for place, name in enumerate(card.sense_names) if bits >> place & 1]
        for bits in range(1, 1 << len(card.sense_names))
    ]
    return {"+".join(each): card.of(each).unknown_above for each in sets}


class TracedVote(NamedTuple):
    """See :class:`~tex_lightning.classifier.vote.Vote`; ``label`` is int64 ()."""

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


class PhotoGraph(nn.Module):
    """Halve a photo as :func:`~tex_lightning.data.decode.halve` does, then its features.

    Args:
        features: Map (1, 3, height, width) uint8 to the network's input.
        half_scale: Whether photos are halved: the mean of 2x2 pixels, rounded half up.
        least: Pixels a side, before that, that one fragment takes.
    """

    def __init__(self, features: nn.Module, half_scale: bool, least: int) -> None:
        super().__init__()
        self.features, self.half_scale, self.least = features, half_scale, least

    def forward(self, photo: Tensor) -> Tensor:
        """Photo (height, width, 3) uint8 to network input (1, 3, height, width)."""
        height, width = (_open(size, self.least) for size in photo.shape[:2])
        planes = photo[:height, :width].permute(2, 0, 1)[None]
        if self.half_scale:  # a last row or column of an odd number is left out
            planes = (avg_pool2d(planes.float(), 2) + 0.5).to(torch.uint8)
        found: Tensor = self.features(planes)
        return found


def _open(size: int, least: int) -> Any:  # noqa: ANN401
    """A size as a value of which the tracer assumes nothing.

    Of a size as such it notes in passing that there is more than one row, as in its example.
    """
    found: Any = torch.scalar_tensor(size, dtype=torch.int64).item()
    promise(found >= least)
    promise(found <= size)
    return found


DRAWS = "draws"
OWN = ("scores", "input", "start")  # outputs of every sense


class ClassifierGraph(nn.Module):
    """The computation of an exported file.

    Inputs are the recordings by modality, signals (axes, samples) float32 and photos (height,
    width, 3) uint8 as they come out of their files, and for a FusionNet ``draws``, int64 (K,
    senses), words of 32 random bits. Outputs are named tensors: ``scores``, ``label``, ``shares``,
    ``probabilities``, ``NAME_scores``, of spectrograms ``NAME_input`` and ``NAME_start``, and
    ``novelty`` where the checkpoint can tell what it has never seen, and ``unknown`` where it is
    to say so.

    Args:
        classifier: Trained; it is copied.

    Raises:
        UserError: If it cannot be exported.
    """

    def __init__(self, classifier: SurfaceClassifier) -> None:
        super().__init__()
        self.card = classifier.card
        senses = classifier.senses
        self.modalities = {name: sense.modality for name, sense in senses.items()}
        self.fronts = nn.ModuleDict({name: _front(each) for name, each in senses.items()})
        networks = {name: exportable(sense.network) for name, sense in senses.items()}
        self.networks = nn.ModuleDict(networks)
        self.fused = classifier.fusion is not None
        self.fusion: Any = exportable(classifier.fusion) if classifier.fusion else None
        self.levels = {name: classifier.embedding_layer(name) for name in senses}
        self.scored = {name: classifier.level(name) != self.levels[name] for name in senses}
        known = {name: classifier.statistics_of(name) for name in senses}
        told = bool(classifier.card.novelties) and None not in known.values()
        self.statistics = nn.ModuleDict(deepcopy(known) if told else {})  # type: ignore[arg-type]

    def forward(self, **given: Tensor) -> dict[str, Tensor]:
        """Classify one sample."""
        outputs: dict[str, Tensor] = {}
        parts: list[Part] = []
        for place, (name, modality) in enumerate(self.modalities.items()):
            own, part = self._sensed(name, place, given[modality])
            outputs |= {**own, **(part.named(name) if self.fused else {})}
            parts.append(part)
        scores, present = parts[0].alone, torch.ones(1, dtype=torch.bool)
        if self.fused:
            scores, present = joined(parts, given[DRAWS])
        # a part of the senses has no temperature of its own
        temperature = torch.where(present.all(), self.card.temperature, 1.0)
        vote = traced_vote(scores, self.card.rule, temperature)
        if novelties := [part.novelty for part in parts if part.novelty is not None]:
            outputs["novelty"] = torch.stack(novelties).sum()
            if self.card.unknown:
                outputs["unknown"] = is_unknown(self.card, outputs["novelty"], present)
        return {"scores": scores, **vote._asdict(), **outputs}

    def _sensed(self, name: str, place: int, recording: Tensor) -> tuple[dict[str, Tensor], Part]:
        """Outputs of one sense by name, and what it adds to all."""
        front, outputs = self.fronts[name], {}
        if isinstance(front, PhotoGraph):
            x = front(recording)
        else:
            x, start = front(recording)
            if isinstance(front, SpectrogramGraph):
                outputs = {f"{name}_input": x[0, 0], f"{name}_start": start}
        network: Any = self.networks[name]
        found: Tensor = network.features(x, self.levels[name])
        alone, partial_logits = self._scores(name, place, found[0].flatten(1))
        rows = found.shape[2:-1] or (1,)
        outputs[f"{name}_scores"] = partial_logits.reshape(-1, *rows, found.shape[-1])
        return outputs, Part.of(partial_logits, alone, self._novelty(name, found))

    def name_inputs(self, names: Sequence[str]) -> None:
        """Let :meth:`forward` have parameters of these names, which torch.export asks for."""

        def forward(**given: Tensor) -> dict[str, Tensor]:
            return type(self).forward(self, **given)

        parameters = [Parameter(name, Parameter.KEYWORD_ONLY) for name in names]
        forward.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        self.forward = forward  # type: ignore[method-assign]

    def _scores(self, name: str, place: int, positions: Tensor) -> tuple[Tensor, Tensor]:
        """Scores (classes, positions) of a sense alone, and what it adds to those of all."""
        if self.scored[name]:
            positions = class_scores(self.networks[name], positions)
        if not self.fused:
            return positions, positions
        partial_logits: Tensor = self.fusion.project(place, positions[None])[0]
        alone = positions if self.fusion.levels[place] == "fc3" else partial_logits
        return alone, partial_logits

    def _novelty(self, name: str, found: Tensor) -> Tensor | None:
        """Novelty (); see :meth:`.FeatureStatistics.novelty`."""
        if name not in self.statistics:
            return None
        statistics: Any = self.statistics[name]
        novelty: Tensor = statistics.novelty(found[0].flatten(1).mean(dim=1))
        return novelty


def sense_outputs(name: str) -> list[str]:
    """Possible names of the outputs that depend on one sense alone."""
    return [*(f"{name}_{each}" for each in OWN), *names(name)]


def is_public(name: str) -> bool:
    """Whether an output is public, and not only passed on inside the file."""
    return "/" not in name


def _front(sense: Sense) -> nn.Module:
    features = sense.features.cpu().eval().requires_grad_(False)
    if sense.medium == "signal":
        return signal_graph(features)
    decoder = sense.decoder
    if not isinstance(decoder, PhotoDecoder):
        raise UserError(
            f"Recordings of {sense.name} are decoded by {type(decoder).__name__}, which no "
            "exported file can do; derive it from SignalDecoder or PhotoDecoder."
        )
    if decoder.resize is not None:
        raise UserError(
            f"This network looks at photos that were brought to {decoder.resize} pixels, which an "
            "exported file cannot do exactly; train with data.resize=null."
        )
    least = max(sense.min_size) if sense.knows_min_size else 1
    return PhotoGraph(features, decoder.half_scale, 2 * least if decoder.half_scale else least)
