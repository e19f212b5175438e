"""A classifier as one traceable module, from decoded recordings to a label.

The senses of a FusionNet are joined in one graph; the decision is that of
:mod:`~tex_lightning.classifier.vote`, with its rule for ties. Layers are rewritten by exact
algebra, so that they can be traced at any size: nothing branches on a size that only a run knows.
"""

from collections.abc import Collection, Sequence
from copy import deepcopy
from functools import reduce
from inspect import Parameter, Signature
from typing import Any

import torch
from torch import Tensor, nn
from torch.nn.functional import avg_pool2d, conv1d, conv2d, max_pool2d, pad

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning.export.signals import SpectrogramGraph, number_of, signal_graph
from tex_lightning.inference.engine import rewritten
from tex_lightning.networks.blocks import Level, ResponseNorm, independent_copy, shared_copy
from tex_lightning.networks.folding import fold_batch_norm
from tex_lightning.senses.base import Sense

LOWEST = torch.finfo(torch.float32).min


class CeilMaxPool(nn.Module):
    """Max pooling that rounds sizes up, as pooling that rounds down a map with a margin.

    A margin of ``stride - 1`` at the far end gives ``floor((n + s - 1 - k) / s) + 1`` places, which
    is ``ceil((n - k) / s) + 1``. With a stride up to the kernel and no padding the last one begins
    inside the map, so the two rules for windows that begin in padding, of PyTorch and of ONNX,
    never differ.

    Args:
        pool: With ``ceil_mode``, without padding and dilation.
    """

    def __init__(self, pool: nn.MaxPool2d) -> None:
        super().__init__()
        self.kernel, self.stride = pool.kernel_size, pool.stride
        self.margin = int(pool.stride) - 1  # type: ignore[arg-type]  # a number, see `fits`

    @staticmethod
    def fits(layer: nn.Module) -> bool:
        """Return whether a layer is such a pooling."""
        if type(layer) is not nn.MaxPool2d or not layer.ceil_mode:
            return False
        square = isinstance(layer.kernel_size, int) and isinstance(layer.stride, int)
        plain = (layer.padding, layer.dilation, layer.return_indices) == (0, 1, False)
        return square and plain and layer.stride <= layer.kernel_size  # type: ignore[operator]

    def forward(self, x: Tensor) -> Tensor:
        """Map (B, C, M, N) to (B, C, M', N')."""
        padded = pad(x, (0, self.margin, 0, self.margin), value=LOWEST)
        return max_pool2d(padded, self.kernel, self.stride)


class BandedResponseNorm(nn.Module):
    """Local response normalisation whose sum over channels is a convolution of kernel 1 by a band.

    Args:
        layer: PyTorch's. Of an even size it sums one channel more before than after each.
    """

    def __init__(self, layer: nn.LocalResponseNorm) -> None:
        super().__init__()
        self.before, self.after = layer.size // 2, (layer.size - 1) // 2
        self.scale, self.k, self.beta = layer.alpha / layer.size, layer.k, layer.beta

    def forward(self, x: Tensor) -> Tensor:
        """Normalise (B, C, M, N), or (B, C, L), across C."""
        channel = torch.arange(x.shape[1], device=x.device)
        apart = channel - channel[:, None]
        band = ((-self.before <= apart) & (apart <= self.after)).to(x.dtype) * self.scale
        if x.dim() == 3:
            sums = conv1d(x.square(), band[:, :, None])
        else:
            sums = conv2d(x.square(), band[:, :, None, None])
        return x / (sums + self.k).pow(self.beta)


def exportable(sense: Sense, levels: Collection[Level]) -> nn.Module:
    """Copy a sense's network without batch normalisation and with layers that can be traced."""
    copied = independent_copy(sense).cpu().float().eval().requires_grad_(False)
    return rewritten(copied, levels, (_make_traceable,))


def _make_traceable(network: nn.Module) -> int:
    """Rewrite what can be rewritten exactly; return how many layers that are."""
    count = fold_batch_norm(network)
    for parent in list(network.modules()):
        for name, layer in parent.named_children():
            if CeilMaxPool.fits(layer):
                setattr(parent, name, CeilMaxPool(layer))  # type: ignore[arg-type]  # as it fits
            elif type(layer) in (nn.LocalResponseNorm, ResponseNorm):
                setattr(parent, name, BandedResponseNorm(layer))  # type: ignore[arg-type]  # one
            else:
                continue
            count += 1
    return count


def fused_scores(partials: Sequence[Tensor], draws: Tensor) -> Tensor:
    """Return the class scores (classes, K) of a FusionNet at random tuples of positions.

    Args:
        partials: Partial logits (classes, positions) of each sense.
        draws: int64 (K, senses); modulo the number of positions each word is a position.
    """
    drawn = []
    for number, partial in enumerate(partials):
        positions = torch.scalar_tensor(partial.shape[1], dtype=torch.int64)
        drawn.append(partial.index_select(1, torch.remainder(draws[:, number], positions)))
    return reduce(torch.add, drawn)


TRACED = ("vote", "mean", "score")  # rules that this module has a form of


def traced_vote(scores: Tensor, rule: str, temperature: float) -> dict[str, Tensor]:
    """Decide by class scores (classes, fragments).

    Returns:
        ``label``, int64 (), and ``shares`` and ``probabilities`` as in
        :class:`~tex_lightning.classifier.vote.Vote`, float32 (classes,).

    Raises:
        UserError: If the rule has no such form.
    """
    if rule not in TRACED:
        raise UserError(
            f"decision.rule={rule} has no form in exported files; give decision.rule one of "
            f"{', '.join(TRACED)}, or add the form to {__name__}."
        )
    classes, wide = torch.arange(scores.shape[0]), scores.double()
    votes = (scores.argmax(dim=0)[None] == classes[:, None]).sum(dim=1)
    fragments = votes.sum()
    probabilities = (wide / temperature).softmax(dim=0).sum(dim=1) / fragments
    if rule == "score":
        probabilities = (wide.mean(dim=1) / temperature).softmax(dim=0)
    chosen = probabilities
    if rule == "vote":  # among those with most votes the most probable, then the first
        chosen = torch.where(votes == votes.max(), probabilities, -1.0)
    return {
        "label": chosen.argmax(),
        "shares": votes.float() / fragments.float(),
        "probabilities": probabilities.float(),
    }


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
        """Map a photo (height, width, 3) uint8 to network input (1, 3, height, width)."""
        # of a size as such the tracer notes in passing that there is more than one row
        height, width = (
            number_of(torch.scalar_tensor(size, dtype=torch.int64), self.least, size)
            for size in photo.shape[:2]
        )
        planes = photo[:height, :width].permute(2, 0, 1)[None]
        if self.half_scale:  # a last row or column of an odd number is left out
            planes = (avg_pool2d(planes.float(), 2) + 0.5).to(torch.uint8)
        features: Tensor = self.features(planes)
        return features


DRAWS = "draws"


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
        self.fronts = nn.ModuleDict({name: _front(sense) for name, sense in senses.items()})
        self.levels = {name: classifier.embedding_layer(name) for name in senses}
        copied = {
            name: shared_copy(sense, network=exportable(sense, [self.levels[name]]))
            for name, sense in senses.items()
        }
        self.classifier = SurfaceClassifier(self.card, copied, deepcopy(classifier.fusion))
        known = {name: classifier.statistics_of(name) for name in senses}
        self.told = bool(self.card.novelties) and None not in known.values()
        self.weighted = {name: classifier.is_weighted(name) for name in senses}
        kept = {name: x for name, x in known.items() if self.told or self.weighted[name]}
        self.classifier.statistics = nn.ModuleDict(deepcopy(kept))  # type: ignore[arg-type]

    @property
    def fused(self) -> bool:
        """Whether several senses are added up, at positions that ``draws`` chooses."""
        return self.classifier.fusion is not None

    def forward(self, **recordings: Tensor) -> dict[str, Tensor]:
        """Classify one sample."""
        outputs: dict[str, Tensor] = {}
        partials, novelties = [], []
        for name, modality in self.modalities.items():
            embedding = self._embedding(name, recordings[modality], outputs)
            positions = embedding[0].flatten(1)
            weighted = self.weighted[name]
            partials.append(self.classifier.partial_logits_of(name, positions, weighted=weighted))
            rows = embedding.shape[2:-1] or (1,)
            grid = partials[-1].reshape(-1, *rows, embedding.shape[-1])
            outputs[f"{name}_scores"] = grid
            if self.told:
                statistics: Any = self.classifier.statistics[name]
                novelties.append(statistics.novelty(positions.mean(dim=1)))
        scores = fused_scores(partials, recordings[DRAWS]) if self.fused else partials[0]
        vote = traced_vote(scores, self.card.rule, self.card.temperature)
        if novelties:
            outputs["novelty"] = torch.stack(novelties).sum()
            if self.card.unknown_above is not None:
                outputs["unknown"] = outputs["novelty"].double() > self.card.unknown_above
        return {"scores": scores, **vote, **outputs}

    def _embedding(self, name: str, recording: Tensor, outputs: dict[str, Tensor]) -> Tensor:
        """Return the embedding (1, D, *positions) of a sense; add what its features put out."""
        front = self.fronts[name]
        x = front(recording)
        if isinstance(front, SpectrogramGraph):
            x, start = x
            outputs |= {f"{name}_input": x[0, 0], f"{name}_start": start}
        network: Any = self.classifier.senses[name].network
        embedding: Tensor = network.features(x, self.levels[name])
        return embedding

    def name_inputs(self, names: Sequence[str]) -> None:
        """Set the parameter names of :meth:`forward`, which torch.export requires."""

        def forward(**given: Tensor) -> dict[str, Tensor]:
            return type(self).forward(self, **given)

        parameters = [Parameter(name, Parameter.KEYWORD_ONLY) for name in names]
        forward.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
        self.forward = forward  # type: ignore[method-assign]


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
            f"This network reads photos that were resized to {decoder.resize} pixels, which an "
            "exported file cannot do exactly; train with data.resize=null."
        )
    least = max(sense.min_size) if sense.knows_min_size else 1
    return PhotoGraph(features, decoder.half_scale, 2 * least if decoder.half_scale else least)
