"""LinearNet: class scores that are linear in the features of a fragment, fitted in closed form.

A rule with one weight for each feature needs few recordings of a class, and fitting it takes a
moment: ridge regression of the classes on the features, as in MiniRocket (Dempster et al. 2021).
"""

import statistics
from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Annotated, cast

import torch
from torch import Tensor, nn

from tex_lightning.core.groups import PARTS, leave_out, left_out_units
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import Head, Level
from tex_lightning.networks.choice import (
    SHARPNESS,
    LeftOut,
    Line,
    fit_line,
    sharpness_of,
)
from tex_lightning.networks.line import (
    RANGE,
    REACH,
    FeatureRange,
    GainlessLine,
    LineOrPlanes,
    RangeGate,
    ScoreReach,
    ShortLine,
)
from tex_lightning.networks.planes import (
    DIRECTIONS,
    ClassPlanes,
    clearly_better_planes,
    fit_planes,
)
from tex_lightning.networks.ridge import whitened

MIN_DEVIATION = 1e-3  # of a feature; one that hardly varies says nothing
OPTIONAL = (("power",), ("axes", "axes_power"))  # kinds of blocks, left out unless they help
GAIN = {"power", "axes_power"}  # kinds of blocks that depend on the gain, beside the levels
CURVED = "mean"  # kind of block in which classes can be planes
WHITENED = "level"  # kind of block whose features vary together, as under another pressure
SHORT_PART = 0.25  # of the fragments of a usual training recording: with fewer it is short

Pair = tuple[Tensor, Tensor]


class LinearNet(nn.Module):
    """Classify every fragment by a ridge regression on its features.

    Every recording is one row, the mean of its fragments, and every class counts alike, however
    many recordings it has. Where each class has a single recording, its fragments are the rows. The
    score of a mean is the mean of the scores, so averaging the fragments' scores is the same as
    classifying the whole recording.

    Features of the kind ``level`` are brought to equal scatter within the classes before the ridge,
    and its scores become linear discriminants (Fisher 1936; Hastie et al. 1994, Flexible
    discriminant analysis): distances to the classes' mean scores in units of the scatter within
    classes, which is shrunk towards equal scatter. New recordings have smaller scores of a class
    the fewer it was fitted to, so that these are scaled by the reliability of a mean of so many.

    The strength of the ridge, and whether blocks of the kinds ``power`` and ``axes`` are used, are
    chosen on the training recordings: by the squared error on groups of them that are left out of
    the fit. Groups of features that lie outside of everything in training do not count in a
    recording (:class:`~tex_lightning.networks.line.RangeGate`).

    Another sensor, clock or hand changes the features of a stroke, and must not change its class.
    So the scores hardly follow the directions in which disturbed recordings differ from themselves:
    their mean square is added to the ridge (Simard et al. 1992, Tangent prop; Bishop 1995, Training
    with noise is equivalent to Tikhonov regularization).

    Where strokes drift in speed and force, a class is a surface in the features and no point. A
    Gaussian of each class that reaches far in two directions, over the fragments of a block of the
    kind ``mean``, takes the line's place where left-out recordings are clearly told apart better
    (:mod:`~tex_lightning.networks.planes`).

    Features of a short recording are noisier, and those of windows that do not fit it differ. So
    recordings of up to a quarter of the usual length have a line of their own, which is fitted to
    pieces of the training recordings, too; not where levels count, as of slow signals, which it did
    not help everywhere (docs/reports/2026-11-26-short-strokes.md).

    Longer features make surer scores, and noise makes features longer. So the scores of recordings
    that lie farther out than those are brought nearer to each other
    (:class:`~tex_lightning.networks.line.ScoreReach`).

    Args:
        classes: Number of materials.
        bands: Features of a fragment, D.
        blocks: Kind and number of the features that belong together, in their order; each block
            counts alike, however many features it has, and blocks of the kind ``level`` are the
            last. None takes all as one.
        bins: Number of the frequency band of each feature, -1 for none; None of all.
        strength: Strength of the ridge, as a share of the mean squared length of a row; None
            chooses it.
        shrinkage: How far the scatter of scores within classes is taken for equal in every
            direction: the fewer rows there are for each class, the further.
        keep_rows: Whether a checkpoint keeps the mean features of the training recordings, from
            which task=adapt fits the network again.

    Example:
        >>> import torch
        >>> from tex_lightning.networks.linear import LinearNet
        >>> network = LinearNet(classes=2, bands=3)
        >>> one, other = torch.rand(1, 3, 20), 1 + torch.rand(1, 3, 20)
        >>> network.fit([one, other, one, other], torch.tensor([0, 1, 0, 1]))
        >>> network(other[None]).argmax(dim=1).unique()
        tensor([1])
    """

    mean: Tensor
    scale: Tensor
    whitening: Tensor

    def __init__(
        self,
        classes: int,
        *,
        bands: int,
        blocks: Sequence[tuple[str, int]] | None = None,
        bins: Sequence[int] | None = None,
        strength: Annotated[
            float | None, "(0, inf)", "strength of the ridge; null: chosen on the training"
        ] = None,
        shrinkage: Annotated[
            float, "[0, inf)", "how far scatter within classes is taken for equal everywhere"
        ] = 30.0,
        keep_rows: Annotated[
            bool, "keep features of the training recordings in the checkpoint, for task=adapt"
        ] = True,
    ) -> None:
        super().__init__()
        self.classes, self.strength, self.shrinkage = classes, strength, shrinkage
        self.keep_rows = keep_rows
        self.blocks = [("", bands)] if blocks is None else [(kind, size) for kind, size in blocks]
        self.levels = sum(size for kind, size in self.blocks if kind == WHITENED)
        self.register_buffer("mean", torch.zeros(bands, 1, 1))
        self.register_buffer("scale", torch.ones(bands, 1, 1))
        self.register_buffer("whitening", torch.eye(self.levels))
        self.head = Head(nn.Sequential(), bands, classes, dropout=0)
        gate = RangeGate(self._gated([-1] * bands if bins is None else bins))
        self.head.scores = LineOrPlanes(gate, self.score_layer)

    def _gated(self, bins: Sequence[int]) -> Tensor:
        """Return which features (groups, D) are out of range together."""
        band = torch.tensor(bins)
        groups = [band == number for number in sorted({*bins} - {-1})]
        block = torch.repeat_interleave(torch.arange(len(self.blocks)), self.sizes)
        groups += [block == index for index, (kind, _) in enumerate(self.blocks) if kind == "power"]
        if self.levels:
            groups.append(torch.arange(len(block)) >= len(block) - self.levels)
        return torch.stack(groups) if groups else torch.zeros(0, len(block))

    def forward(self, x: Tensor) -> Tensor:
        """Map features (B, 1, D, L) to class scores before softmax (B, classes, L)."""
        return self.features(x, "fc3")

    def features(self, x: Tensor, level: Level) -> Tensor:
        """Return what fusion samples from: standardised features, or class scores.

        Features are standardised so that next to nothing is left to the bias, which a FusionNet
        adds once for all senses.

        Args:
            x: Features (B, 1, D, L).
            level: "fc2" for the features (B, D, L), "fc3" for the scores (B, classes, L).
        """
        x = (x.transpose(1, 2) - self.mean).mul_(self.scale)  # an hour has hundreds of megabytes
        if self.levels:
            x[:, -self.levels :, 0] = self.whitening.T @ x[:, -self.levels :, 0]
        scores: Tensor = self.head(x, level)
        return scores.squeeze(2)

    @property
    def cuts(self) -> bool:
        """Whether :meth:`fit` makes use of pieces."""
        return not self.levels

    @property
    def sizes(self) -> Tensor:
        """Number of features of each block."""
        return torch.tensor([size for _, size in self.blocks])

    @property
    def score_layer(self) -> nn.Conv2d:
        """FC3, the only layer."""
        return self.head.score_layer

    @torch.no_grad()
    def fit(
        self,
        inputs: Sequence[Tensor],
        labels: Tensor,
        groups: Sequence[str] | None = None,
        recordings: Sequence[int] | None = None,
        pieces: Sequence[tuple[int, Tensor]] = (),
        disturbed: Sequence[Pair] = (),
    ) -> None:
        """Fit the scores to all training recordings at once.

        The scores are brought to the size at which the softmax of a recording's mean score is a
        probability: measured on each part of the recordings by a fit to the others, or on each
        fragment where every class has but one recording, which overestimates.

        Args:
            inputs: Features (1, D, L) of each recording.
            labels: (recordings,) class indices, each at least once.
            groups: What was recorded together, of each recording; None takes each by itself.
            recordings: Number of the recording that each input is a version of; None takes each for
                another.
            pieces: Numbers of inputs, and the features (1, D, L) of a short piece of each.
            disturbed: Features (1, D, L) of recordings, and of the same with a change that changes
                no class.

        Raises:
            UserError: If all recordings have the same features.
        """
        counted = recordings or range(len(labels))
        given = labels = labels.cpu()
        rows, labels, left_out = _rows(inputs, labels, groups or counted, counted)
        whole = len(rows) == len(inputs)  # else fragments
        usual = statistics.median(features.shape[-1] for features in inputs)
        mean, deviation = rows.mean(dim=0), rows.std(dim=0, correction=0)
        scale = torch.where(deviation > MIN_DEVIATION, 1 / deviation, 0)
        share = torch.repeat_interleave(self.sizes.double().rsqrt(), self.sizes)  # of unit length
        rows, changes = rows.sub_(mean).mul_(scale * share), self._changes(disturbed, scale * share)
        fitted = partial(
            fit_line, labels=labels, left_out=left_out, classes=self.classes,
            strength=self.strength, shrinkage=self.shrinkage,
        )  # fmt: skip
        subsets = [kept for kept in self._subsets() if (kept * scale).any()]
        if not subsets:
            raise UserError(
                "All training recordings are alike: no feature differs between them, as of "
                "silence, constant signals or one recording that is given for all; check them."
            )
        line = fitted(rows, changes=changes, subsets=subsets, levels=self.levels)
        others, gainless = slice(len(share) - self.levels), None
        subsets = [kept[others] for kept in self._subsets(without=GAIN)]
        subsets = [kept for kept in subsets if (kept * scale[others]).any()]
        if self.levels and subsets:
            gainless = fitted(
                rows[:, others], changes=changes[:, others], subsets=subsets, levels=0
            )
        rows = whitened(rows, line.whitening).div_(share)  # in place: many take all the memory
        self.mean.copy_(mean[:, None, None])
        self.scale.copy_(scale[:, None, None])
        self.whitening.copy_(line.whitening)
        gate: RangeGate = self.head.scores[0]  # type: ignore[index]
        gate.limits.copy_(gate.limits_of(rows))
        gate.fragments.fill_(usual if whole else 1)
        weights, bias = line.enlarged(share)
        self.score_layer.weight.copy_(weights[:, :, None, None])
        self.score_layer.bias = nn.Parameter(bias.to(self.score_layer.weight))
        self._fit_planes(inputs, labels, line, whole=whole and usual >= 2)
        other: GainlessLine = self.head.scores.gainless  # type: ignore[assignment]
        other.fit(line, gainless if self.head.scores.is_linear else None, rows, share)
        most = int(usual * SHORT_PART)
        within: FeatureRange = getattr(self.head.scores, RANGE)
        within.take(None)
        if self.head.scores.is_linear and not self.levels:  # they tell much by their range
            means = rows
            if not whole:
                every = torch.split(rows, [features.shape[-1] for features in inputs])
                means = torch.stack([fragments.mean(dim=0) for fragments in every])
            within.fit(means, len({*counted}), most)
        self._fit_short(inputs, given, groups, counted, pieces, disturbed, most)
        self._fit_reach(rows, pieces, share.square())

    def _fit_reach(self, rows: Tensor, pieces: Sequence[tuple[int, Tensor]], share: Tensor) -> None:
        """Fit how far out recordings lie that scores are sure of.

        Args:
            rows: Standardised training rows (rows, D).
            pieces: Numbers of inputs, and the features of a piece of each.
            share: Of each feature in the squared length of a row (D,).
        """
        reach: ScoreReach = self.head.scores.reach  # type: ignore[assignment]
        reach.take(None)
        if not self.head.scores.is_linear:
            return
        gate: RangeGate = self.head.scores[0]  # type: ignore[index]
        lengths: dict[int, float] = {}  # of the longest piece of each
        for number, piece in pieces:
            mean = self.features(piece.mean(dim=2)[None, :, :, None], "fc2")
            inside = gate(mean[..., None], (mean, piece.shape[2])).double().flatten()
            lengths[number] = max(lengths.get(number, 0.0), float(inside.square() @ share))
        if lengths:
            reach.fit(torch.tensor([*lengths.values()]), share, 1)
        else:
            reach.fit(rows.square() @ share, share, REACH)

    def _changes(self, disturbed: Sequence[Pair], scale: Tensor) -> Tensor:
        """Return by how much disturbed rows differ, each of length one: (changes, D).

        Kinds of disturbance count alike then, whether they are strong or weak. Levels, which a
        disturbance need not keep, count nothing.

        Args:
            disturbed: As of :meth:`fit`.
            scale: By which features are multiplied (D,).
        """
        pairs = [[x[0].double().cpu().mean(dim=1) for x in pair] for pair in disturbed]
        changes = torch.zeros(len(pairs), len(scale)).double()
        for row, (before, after) in zip(changes, pairs, strict=True):
            row.copy_((after - before) * scale)
        changes[:, len(scale) - self.levels :] = 0
        lengths = changes.norm(dim=1)
        unit: Tensor = changes[lengths > 0] / lengths[lengths > 0, None]
        return unit

    def _fit_planes(
        self, inputs: Sequence[Tensor], labels: Tensor, line: Line, *, whole: bool
    ) -> None:
        """Fit planes of the classes in one of the blocks of means, if they clearly beat the line.

        Args:
            inputs: Features (1, D, L) of each recording.
            labels: (recordings,) class indices.
            line: The line.
            whole: Whether its rows are recordings, of which fragments are parts.
        """
        planes: ClassPlanes = self.head.scores.planes  # type: ignore[assignment]
        planes.take(None)
        if not whole:
            return
        some, few, (parts, units), rival = line.tried
        mean, scale = (x.double().cpu()[:, :, 0] for x in (self.mean, self.scale))
        ends = self.sizes.cumsum(dim=0).tolist()
        spans = [
            slice(end - size, end)
            for end, (kind, size) in zip(ends, self.blocks, strict=True)
            if kind == CURVED and size > DIRECTIONS and scale[end - size : end].any()
        ]

        def cut(span: slice, some: Iterable[int]) -> list[Tensor]:
            chosen = (inputs[number][0, span] for number in some)
            return [((x.double().cpu() - mean[span]) * scale[span]).T for x in chosen]

        chosen = clearly_better_planes(
            (cut(span, some.tolist()) for span in spans), few, parts, units, rival
        )
        if chosen is not None:
            number, scores = chosen
            sharpness = sharpness_of(scores, few, parts, 1 / SHARPNESS)
            every = cut(spans[number], range(len(inputs)))
            fitted = fit_planes(every, labels, self.classes)
            wide = torch.zeros(len(fitted.projection), len(scale)).double()
            wide[:, spans[number]] = fitted.projection
            planes.fit(fitted._replace(projection=wide), sharpness)

    def _fit_short(
        self,
        inputs: Sequence[Tensor],
        labels: Tensor,
        groups: Sequence[str] | None,
        recordings: Sequence[int],
        pieces: Sequence[tuple[int, Tensor]],
        disturbed: Sequence[Pair],
        most: int,
    ) -> None:
        """Fit the line of short recordings to pieces of recordings beside the whole ones.

        Args:
            inputs: Features (1, D, L) of each recording.
            labels: (recordings,) class indices.
            groups: Group of each recording, if that is known.
            recordings: Number of the recording that each input is a version of.
            pieces: Numbers of inputs, and the features of a piece of each.
            disturbed: Features of recordings, and of the same with a change.
            most: Fragments of the longest recording that is short.
        """
        short: ShortLine = self.head.scores.short  # type: ignore[assignment]
        short.take(None)
        whole = sorted({number for number, _ in pieces})
        unused = not (self.cuts and most and self.head.scores.is_linear)
        if unused or {*labels[whole].tolist()} != {*range(self.classes)}:
            return
        rows = [(number, inputs[number]) for number in whole] + [*pieces]
        numbers, features = [number for number, _ in rows], [x for _, x in rows]
        other = LinearNet(
            self.classes, bands=len(self.mean), blocks=self.blocks, strength=self.strength,
            shrinkage=self.shrinkage,
        )  # fmt: skip
        other.fit(
            features, labels[numbers], groups and [groups[number] for number in numbers],
            [recordings[number] for number in numbers], disturbed=disturbed,
        )  # fmt: skip
        weight, bias = self._translated(other)
        short.take({"weight": weight, "bias": bias, "most": torch.tensor(float(most))})

    def _translated(self, other: "LinearNet") -> tuple[Tensor, Tensor]:
        """Return the weights (classes, D, 1, 1) and biases that score alike by own features."""
        layer, scale = other.score_layer, self.scale.double().flatten()
        weight = layer.weight.double().flatten(1) * other.scale.double().flatten()
        shift = weight @ (self.mean - other.mean).double().flatten()
        weight = torch.where(scale > 0, weight / scale, 0)[:, :, None, None]
        return weight, cast(Tensor, layer.bias).double() + shift

    def _subsets(self, without: Collection[str] = ()) -> Iterator[Tensor]:
        """Yield which features (D,) are used: with every choice of optional blocks, none first.

        Those of the kinds ``without`` never are.
        """
        blocks = {kind for kind, _ in self.blocks}.difference(without)
        optional = [kinds for kinds in OPTIONAL if blocks.intersection(kinds)]
        for wanted in product((False, True), repeat=len(optional)):
            unused = (kinds for kinds, use in zip(optional, wanted, strict=True) if not use)
            used = blocks.difference(*unused)
            kept = torch.tensor([kind in used for kind, _ in self.blocks])
            if kept.any():
                yield torch.repeat_interleave(kept, self.sizes).double()


def _rows(
    inputs: Sequence[Tensor],
    labels: Tensor,
    groups: Sequence[Hashable],
    recordings: Sequence[Hashable],
) -> tuple[Tensor, Tensor, LeftOut]:
    """Return a row for each recording, or for each fragment where each class has one recording.

    Returns:
        Rows (rows, D), their labels, and how they are left out.
    """
    parts = torch.tensor(leave_out(labels.tolist(), groups, recordings))
    named = left_out_units(labels.tolist(), groups, recordings)
    numbers = {unit: number for number, unit in enumerate(dict.fromkeys(named))}
    units = torch.tensor([numbers[unit] for unit in named])
    if bool((parts >= 0).any()):
        rows = torch.empty(len(inputs), inputs[0].shape[1], dtype=torch.float64)
        for row, features in zip(rows, inputs, strict=True):
            row.copy_(features[0].double().mean(dim=1))
        return rows, labels, LeftOut(parts, units)
    fragments = torch.tensor([features.shape[-1] for features in inputs])
    rows = torch.cat([features[0].T for features in inputs]).cpu().double()
    labels, units = (torch.repeat_interleave(x, fragments) for x in (labels, units))
    return rows, labels, LeftOut(torch.arange(len(rows)) % PARTS, units)
