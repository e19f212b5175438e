"""A trained classifier as one traceable module from decoded recordings to a label."""

from collections.abc import Sequence
from copy import deepcopy
from inspect import Parameter, Signature
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.branches import Branch
from tex_lightning.classifier import SurfaceClassifier, class_scores
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning.export.joining import Part, is_unknown, joined, names
from tex_lightning.export.layers import exportable
from tex_lightning.export.photos import PhotoGraph
from tex_lightning.export.signals import SpectrogramGraph, signal_graph
from tex_lightning.export.vote import traced_vote

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
        branches = classifier.branches
        self.modalities = {name: branch.modality for name, branch in branches.items()}
        self.fronts = nn.ModuleDict({name: _front(each) for name, each in branches.items()})
        self.network = exportable(classifier.network)
        self.fused = classifier.fusion is not None
        self.levels = {name: classifier.described_level(name) for name in branches}
        self.scored = {name: classifier.level(name) != self.levels[name] for name in branches}
        known = {name: classifier.statistics_of(name) for name in branches}
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
        found = self._described(name, place, x)
        alone, summand = self._scores(name, place, found[0].flatten(1))
        rows = found.shape[2:-1] or (1,)
        outputs[f"{name}_scores"] = summand.reshape(-1, *rows, found.shape[-1])
        return outputs, Part.of(summand, alone, self._novelty(name, found))

    def name_inputs(self, names: Sequence[str]) -> None:
        """Let :meth:`forward` have parameters of these names, which torch.export asks for."""

        def forward(**given: Tensor) -> dict[str, Tensor]:
            return type(self).forward(self, **given)

        parameters = [Parameter(name, Parameter.KEYWORD_ONLY) for name in names]
        forward.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        self.forward = forward  # type: ignore[method-assign]

    def _network(self, place: int) -> Any:  # noqa: ANN401
        network: Any = self.network
        return network.networks[place] if self.fused else network

    def _described(self, name: str, place: int, x: Tensor) -> Tensor:
        """Features (1, D, *positions) that scores and novelty are computed from."""
        found: Tensor = self._network(place).features(x, self.levels[name])
        return found

    def _scores(self, name: str, place: int, positions: Tensor) -> tuple[Tensor, Tensor]:
        """Scores (classes, positions) of a sense alone, and what it adds to those of all."""
        if self.scored[name]:
            positions = class_scores(self._network(place), positions)
        if not self.fused:
            return positions, positions
        network: Any = self.network
        summand: Tensor = network.project(place, positions[None])[0]
        return (positions if network.levels[place] == "fc3" else summand), summand

    def _novelty(self, name: str, found: Tensor) -> Tensor | None:
        """Novelty (); see :meth:`~tex_lightning.networks.statistics.FeatureStatistics.novelty`."""
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


def _front(branch: Branch) -> nn.Module:
    features = branch.features.cpu().eval().requires_grad_(False)
    if branch.medium == "signal":
        return signal_graph(features)
    decoder = branch.decoder
    if not isinstance(decoder, PhotoDecoder):
        raise UserError(
            f"Recordings of {branch.name} are decoded by {type(decoder).__name__}, which no "
            "exported file can do; derive it from SignalDecoder or PhotoDecoder."
        )
    if decoder.resize is not None:
        raise UserError(
            f"This network looks at photos that were brought to {decoder.resize} pixels, which an "
            "exported file cannot do exactly; train with data.resize=null."
        )
    least = max(branch.min_size) if branch.knows_min_size else 1
    return PhotoGraph(features, decoder.half_scale, 2 * least if decoder.half_scale else least)
