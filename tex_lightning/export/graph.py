"""A trained classifier as one module from decoded recordings to a label, made to be traced."""

from collections.abc import Sequence
from inspect import Parameter, Signature
from typing import Any

import torch
from torch import Tensor, nn

from tex_lightning.branches import Branch
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning.export.layers import exportable
from tex_lightning.export.photos import PhotoGraph
from tex_lightning.export.signals import SpectrogramGraph, signal_graph
from tex_lightning.export.vote import traced_vote

DRAWS = "draws"


class ClassifierGraph(nn.Module):
    """What an exported file computes.

    Inputs are the recordings by modality, signals (axes, samples) float32 and photos (height,
    width, 3) uint8 as they come out of their files, and for a FusionNet ``draws``, int64 (K,
    senses), words of 32 random bits. Outputs are named tensors: ``scores``, ``label``, ``shares``,
    ``probabilities``, ``NAME_scores``, and of spectrograms ``NAME_input`` and ``NAME_start``.

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

    def forward(self, **given: Tensor) -> dict[str, Tensor]:
        """Classify one sample."""
        summands: list[Tensor] = []
        outputs: dict[str, Tensor] = {}
        for place, (name, modality) in enumerate(self.modalities.items()):
            front, recording = self.fronts[name], given[modality]
            if isinstance(front, PhotoGraph):
                x = front(recording)
            else:
                x, start = front(recording)
                if isinstance(front, SpectrogramGraph):
                    outputs |= {f"{name}_input": x[0, 0], f"{name}_start": start}
            dense = self._dense(place, x)
            outputs[f"{name}_scores"] = dense
            summands.append(dense.flatten(1))
        scores = self._drawn(summands, given[DRAWS]) if self.fused else summands[0]
        vote = traced_vote(scores, self.card.rule, self.card.temperature)
        return {"scores": scores, **vote._asdict(), **outputs}

    def name_inputs(self, names: Sequence[str]) -> None:
        """Let :meth:`forward` have parameters of these names, which torch.export asks for."""

        def forward(**given: Tensor) -> dict[str, Tensor]:
            return type(self).forward(self, **given)

        parameters = [Parameter(name, Parameter.KEYWORD_ONLY) for name in names]
        forward.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        self.forward = forward  # type: ignore[method-assign]

    def _dense(self, place: int, x: Tensor) -> Tensor:
        """Scores (classes, rows, columns) of every position, or what a sense adds to them."""
        network: Any = self.network
        found = network.features(place, x) if self.fused else network.features(x, "fc3")
        positions = found.flatten(2)
        if self.fused:
            positions = network.project(place, positions)
        rows = found.shape[2:-1] or (1,)
        dense: Tensor = positions[0].reshape(-1, *rows, found.shape[-1])
        return dense

    def _drawn(self, summands: list[Tensor], draws: Tensor) -> Tensor:
        """Scores (classes, K) of random tuples of positions."""
        drawn = []
        for place, each in enumerate(summands):
            positions = torch.scalar_tensor(each.shape[1], dtype=torch.int64)
            drawn.append(each.index_select(1, torch.remainder(draws[:, place], positions)))
        total, *others = drawn
        for each in others:
            total = total + each
        return total


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
