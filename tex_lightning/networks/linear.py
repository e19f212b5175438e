"""LinearNet: class scores that are linear in the features of a fragment, fitted in closed form.

A rule with one weight for each feature needs few recordings of a class, and fitting it takes a
moment: ridge regression of the classes on the features, as in MiniRocket (Dempster et al. 2021).
"""

import math
import statistics
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from itertools import product
from typing import Annotated, NamedTuple, cast

import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor, nn

from tex_lightning.core.groups import PARTS, leave_out, left_out_units
from tex_lightning.networks.blocks import Head, Level
from tex_lightning.networks.planes import (
    DIRECTIONS,
    ClassPlanes,
    LineOrPlanes,
    ShortLine,
    clearly_better_planes,
    fit_planes,
)
from tex_lightning.networks.ridge import (
    Products,
    Ridge,
    discriminants,
    reliability_of_means,
    reliability_of_one,
)

MIN_DEVIATION = 1e-3  # of a feature; one that hardly varies says nothing
SHARPNESS = 10.0  # of scores from about 0 to 1, to begin with
STRENGTHS = (0.001, 0.01, 0.1, 1.0)  # of the ridge, at first; the grid goes on at its ends
STRENGTH_LIMITS = (1e-6, 1e4)
TIE = 1.01  # errors within 1 % are equal, and the stronger ridge is taken
WITHIN = (0.1, 1.0)  # weights of the scatter within recordings, beside none
OPTIONAL = ("power", "axes")  # kinds of blocks that are left out unless they help
CURVED = "mean"  # kind of block in which classes can be planes
WHITENED = "level"  # kind of block whose features vary together, as under another pressure
MARGIN = 4.0  # over the root of the rows: of few the largest length says little about the next
MIN_RELIABILITY = 0.05  # of one recording's score
MANY = 5  # recordings of a class, from which on its scores are as large as with more
MAX_THINNED = 50  # classes that reliability is measured on
MAX_ROWS = 600  # that settings are chosen on
LEAST_ROWS, SOME_CLASSES = 5, 60  # of a class; where fewer are left of each, so many classes
BLOCK = 1000  # rows that are measured at once
SHORT_PART = 0.25  # of the fragments of a usual training recording: with fewer it is short
MAX_FRAGMENTS = 400  # that tell the scatter within recordings


class Choice(NamedTuple):
    """Settings that were tried on rows that were left out.

    Attributes:
        products: Products of the rows by the features in use.
        within: Weight of the scatter within recordings.
        ridge: The ridge.
        scores: Scores (rows, classes) of each row when it was left out.
        errors: Squared error (rows,) of each, times its weight.
    """

    products: Products
    within: float
    ridge: float
    scores: Tensor
    errors: Tensor

    @property
    def error(self) -> float:
        """The weighted mean squared error."""
        return float(self.errors.sum())


class RangeGate(nn.Module):
    """Take out groups of features that lie outside of everything in training.

    Another gain or mount of the sensor, or a hum, is no property of the material. A group becomes
    zero, the mean of the training, if its mean over the recording is longer than its limit. Groups
    are what depends on gain and mount (``power``, ``level``), and every frequency band.

    Args:
        member: Which features each group has, (groups, D).

    Attributes:
        limits: Largest squared length of each group.
        fragments: Fragments of a usual training recording; the mean of fewer varies more.
    """

    member: Tensor
    limits: Tensor
    fragments: Tensor

    def __init__(self, member: Tensor) -> None:
        super().__init__()
        self.register_buffer("member", member.float(), persistent=False)
        self.register_buffer("limits", torch.full((len(member),), torch.finfo().max))
        self.register_buffer("fragments", torch.ones(()))

    def limits_of(self, rows: Tensor) -> Tensor:
        """Return the limits (groups,) that training on rows (rows, D) gives."""
        margin, blocks = 1 + MARGIN / len(rows) ** 0.5, torch.split(rows[:, :, None], BLOCK)
        longest = torch.stack([self.lengths(x).amax(dim=0) for x in blocks]).amax(dim=0)
        limits: Tensor = (margin**2 * longest).clamp_min(torch.finfo().tiny)
        return limits.to(self.limits)

    def lengths(self, x: Tensor) -> Tensor:
        """Return squared lengths (B, groups) of the mean of features (B, D, positions...)."""
        squares: Tensor = x.flatten(2).mean(dim=2).square() @ self.member.to(x.dtype).T
        return squares

    def forward(self, x: Tensor, whole: tuple[Tensor, int] | None = None) -> Tensor:
        """Return features (B, D, M, N) with zeros in the groups that are out of range.

        Args:
            x: Features of all fragments of a recording, or of some.
            whole: Mean (B, D, 1) of all its fragments and their number; None takes those of ``x``.
        """
        mean, count = (x, x[0, 0].numel()) if whole is None else whole
        limits = self.limits * (self.fragments / count).clamp_min(1)
        outside = (self.lengths(mean) > limits).to(x.dtype) @ self.member.to(x.dtype)
        inside: Tensor = x * (1 - outside.clamp(max=1))[:, :, None, None]
        return inside


class LinearNet(nn.Module):
    """Classify every fragment by a ridge regression on its features.

    Every recording is one row, the mean of its fragments, and every class counts alike, however
    many recordings it has. Where each class has a single recording, its fragments are the rows. The
    score of a mean is the mean of the scores, so averaging the fragments' scores is the same as
    classifying the whole recording.

    What varies within recordings is noise, too: its scatter may be added to the ridge, unless
    levels count, which drift. Features of the kind ``level`` are brought to equal scatter within
    the classes before the ridge, and its scores become linear discriminants (Fisher 1936; Hastie et
    al. 1994, Flexible discriminant analysis): distances to the classes' mean scores in units of the
    scatter within classes, which is shrunk towards equal scatter. New recordings have smaller
    scores of a class the fewer it was fitted to, so that these are scaled by the reliability of a
    mean of so many.

    The strength of the ridge, the weight of the scatter within recordings, and whether blocks of
    the kinds ``power`` and ``axes`` are used, are chosen on the training recordings: by the squared
    error on groups of them that are left out of the fit. Groups of features that lie outside of
    everything in training do not count in a recording (:class:`RangeGate`).

    Where strokes drift in speed and force, a class is a surface in the features and no point. A
    Gaussian of each class that reaches far in two directions, over the fragments of a block of the
    kind ``mean``, takes the line's place where left-out recordings are clearly told apart better
    (:mod:`~tex_lightning.networks.planes`).

    Features of a short recording are noisier, and those of windows that do not fit it differ. So
    recordings of up to a quarter of the usual length have a line of their own, which is fitted to
    pieces of the training recordings, too; not where levels count, as of slow signals, which it did
    not help everywhere (docs/reports/2026-11-26-short-strokes.md).

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
        groups = [torch.tensor(bins) == number for number in sorted({*bins} - {-1})]
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
        """
        counted = recordings or range(len(labels))
        given = labels = labels.cpu()
        rows, labels, parts, units = _rows(inputs, labels, groups or counted, counted)
        usual = statistics.median(features.shape[-1] for features in inputs)
        mean, deviation = rows.mean(dim=0), rows.std(dim=0, correction=0)
        scale = torch.where(deviation > MIN_DEVIATION, 1 / deviation, 0)
        share = torch.repeat_interleave(self.sizes.double().rsqrt(), self.sizes)  # of unit length
        rows, within = rows.sub_(mean).mul_(scale * share), _spread(inputs) * scale * share
        some, nth = _chosen(labels, self.classes)
        few, few_parts, few_units = labels[some] // nth, parts[some], units[some]
        ridge = Ridge(rows[some], few, math.ceil(self.classes / nth), within, self.levels)
        choice = self._choose(ridge, few_parts)
        one, counts = self._reliability(ridge, choice, few_parts, few_units)
        factors = _factors(one, counts)
        left_out = self._left_out_scores(ridge, choice, few_parts, factors)
        if nth == 1:
            sharpness = _sharpness(left_out, few, few_parts, SHARPNESS)
        else:
            factors = _factors(one, _count_units(labels, units, self.classes))
            sharpness = self._sharpness_of_one_part(rows, labels, parts, ridge, choice, factors)
        whole = Ridge(rows, labels, self.classes, within, self.levels)
        whitening, weights, bias = self._solve(whole, choice)
        rows = whole.whitened(rows, whitening).div_(share)  # in place: many take all the memory
        self.mean.copy_(mean[:, None, None])
        self.scale.copy_(scale[:, None, None])
        self.whitening.copy_(whitening)
        gate: RangeGate = self.head.scores[0]  # type: ignore[index]
        gate.limits.copy_(gate.limits_of(rows))
        gate.fragments.fill_(usual if len(rows) == len(inputs) else 1)
        weights, bias = (_enlarged(x, factors * sharpness) for x in (share * weights.T, bias))
        self.score_layer.weight.copy_(weights[:, :, None, None])
        self.score_layer.bias = nn.Parameter(bias.to(self.score_layer.weight))
        left_out = left_out if len(rows) == len(inputs) and usual >= 2 else left_out[:0]
        self._fit_planes(inputs, labels, some, (few, few_parts, few_units, left_out))
        self._fit_short(inputs, given, groups, counted, pieces, int(usual * SHORT_PART))

    def _fit_planes(
        self,
        inputs: Sequence[Tensor],
        labels: Tensor,
        some: Tensor,
        tried: tuple[Tensor, Tensor, Tensor, Tensor],
    ) -> None:
        """Fit planes of the classes in one of the blocks of means, if they clearly beat the line.

        Args:
            inputs: Features (1, D, L) of each recording.
            labels: (recordings,) class indices.
            some: Numbers of the recordings that settings are chosen on.
            tried: Of these the class, the part in which each is left out, -1 for none, the number
                of what it is left out with, and the line's scores when it was; none of the last
                where fragments are no parts of recordings.
        """
        planes: ClassPlanes = self.head.scores.planes  # type: ignore[assignment]
        planes.take(None)
        few, parts, units, rival = tried
        if not len(rival):
            return
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
            sharpness = _sharpness(scores, few, parts, 1 / SHARPNESS)
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
        most: int,
    ) -> None:
        """Fit the line of short recordings to pieces of recordings beside the whole ones.

        Args:
            inputs: Features (1, D, L) of each recording.
            labels: (recordings,) class indices.
            groups: Group of each recording, if that is known.
            recordings: Number of the recording that each input is a version of.
            pieces: Numbers of inputs, and the features of a piece of each.
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
            [recordings[number] for number in numbers],
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

    def _choose(self, ridge: Ridge, parts: Tensor) -> Choice:
        """Choose the settings with the smallest error on the parts that are left out.

        The scatter within recordings is added only if that is better by more than a standard error.
        """
        simple, other = [], []
        for kept in self._subsets():
            products = ridge.products(kept)
            simple.append(self._best_strength(ridge, products, 0, parts))
            if len(ridge.within) and not self.levels:
                other += [self._best_strength(ridge, products, x, parts) for x in WITHIN]
        best = min(simple, key=lambda choice: choice.error)
        if other:
            rival = min(other, key=lambda choice: choice.error)
            gain = (best.errors - rival.errors)[parts >= 0]
            if gain.sum() > gain.std(correction=0) * len(gain) ** 0.5:
                best = rival
        return best

    def _best_strength(
        self, ridge: Ridge, products: Products, within: float, parts: Tensor
    ) -> Choice:
        """Return the choice of strength with the smallest error, inside of what was tried."""
        targets, weights = ridge.targets, ridge.weights(parts >= 0)

        def tried(strength: float) -> Choice:
            size = strength * products.size

            def scores(rest: Tensor) -> Tensor:
                return ridge.scores(ridge.kernel(products, within, size, rest), size, rest)

            left_out = _left_out(scores, parts, ridge.classes)
            errors = weights * (left_out - targets).square().sum(dim=1)
            return Choice(products, within, size, left_out, errors)

        grid = STRENGTHS if self.strength is None else (self.strength,)
        choices = {strength: tried(strength) for strength in grid}
        while self.strength is None:
            best = min(choices, key=lambda strength: choices[strength].error)
            further = best * 10 if best == max(choices) else best / 10
            low, high = STRENGTH_LIMITS
            if min(choices) < best < max(choices) or not low < further < high:
                break
            choices[further] = tried(further)
        least = min(choice.error for choice in choices.values())
        return choices[max(x for x, choice in choices.items() if choice.error <= TIE * least)]

    def _reliability(
        self, ridge: Ridge, choice: Choice, parts: Tensor, units: Tensor
    ) -> tuple[float | None, Tensor]:
        """Return the reliability of one unit's score, and the units (classes,) of each class.

        What share of a score new recordings keep is measured by the parts that are left out, and
        with as few units as the smallest class has. It is None where classes need not differ.
        """
        counts = _count_units(ridge.labels, units, ridge.classes).clamp_min(1)
        least = int(counts.min())
        larger = (counts > least).nonzero()[:MAX_THINNED, 0].tolist()
        if not larger or least >= MANY:
            return None, counts
        shares: list[tuple[float, float, float]] = []
        for label in larger:
            members = torch.tensor(sorted({*units[ridge.labels == label].tolist()}))
            out = (ridge.labels == label) & ~torch.isin(units, members[:least])
            kernel = ridge.kernel(choice.products, choice.within, choice.ridge, ~out)
            thinned = _share(ridge.scores(kernel, choice.ridge, ~out)[out], label)
            divided = len({*parts[ridge.labels == label].tolist()})
            fitted = float(counts[label]) * (1 - 1 / divided)
            shares.append((thinned, _share(choice.scores[out], label), fitted))
        thinned, whole, fitted = (sum(x) / len(larger) for x in zip(*shares, strict=True))
        one = thinned
        if fitted > least:
            one = reliability_of_one(thinned / max(whole, 1e-9), least, fitted)
        return min(max(one, MIN_RELIABILITY), 1.0), counts

    def _scores(self, ridge: Ridge, choice: Choice, rest: Tensor, factors: Tensor) -> Tensor:
        """Return the final scores (rows, classes) of all rows by a fit to some of them."""
        kernel = ridge.kernel(choice.products, choice.within, choice.ridge, rest)
        scores = ridge.scores(kernel, choice.ridge, rest)
        coefficients, intercept = self._discriminants(scores[rest], ridge.labels[rest])
        return _enlarged((scores @ coefficients + intercept).T, factors).T

    def _left_out_scores(
        self, ridge: Ridge, choice: Choice, parts: Tensor, factors: Tensor
    ) -> Tensor:
        """Return the final scores (rows, classes) of each row by a fit without its part."""
        return _left_out(
            lambda rest: self._scores(ridge, choice, rest, factors), parts, ridge.classes
        )

    def _sharpness_of_one_part(
        self,
        rows: Tensor,
        labels: Tensor,
        parts: Tensor,
        ridge: Ridge,
        choice: Choice,
        factors: Tensor,
    ) -> float:
        """Return the scale of scores as :func:`_sharpness` does, by the largest part alone.

        All classes are told apart, which are too many for a fit without each part.
        """
        out = parts == parts[parts >= 0].mode().values
        rest = Ridge(rows[~out], labels[~out], self.classes, ridge.within, self.levels)
        whitening, weights, bias = self._solve(rest, choice)
        scores = rest.whitened(rows[out], whitening) @ weights + bias
        scores, about = _enlarged(scores.T, factors).T, SHARPNESS
        for _ in range(2):  # of many classes it is beyond ten times of the first
            about = _sharpness(scores, labels[out], parts[out], about)
        return about

    def _solve(self, ridge: Ridge, choice: Choice) -> tuple[Tensor, Tensor, Tensor]:
        """Return whitening, weights (D, classes) and bias (classes,) of the fit to all rows."""
        weights, offset, whitening = ridge.solve(choice.products, choice.within, choice.ridge)
        scores = ridge.whitened(ridge.rows, whitening) @ weights + offset
        coefficients, intercept = self._discriminants(scores, ridge.labels)
        return whitening, weights @ coefficients, offset @ coefficients + intercept

    def _discriminants(self, scores: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
        classes = scores.shape[1]
        freedom = max(1, len(scores) - classes)  # with which the scatter is known
        return discriminants(scores, labels, self.shrinkage * classes / freedom)

    def _subsets(self) -> Iterator[Tensor]:
        """Yield which features (D,) are used: with every choice of optional blocks, none first."""
        kinds = [kind for kind in OPTIONAL if any(kind == name for name, _ in self.blocks)]
        for wanted in product((False, True), repeat=len(kinds)):
            left_out = {kind for kind, use in zip(kinds, wanted, strict=True) if not use}
            kept = torch.tensor([kind not in left_out for kind, _ in self.blocks])
            if kept.any():
                yield torch.repeat_interleave(kept, self.sizes).double()


def _rows(
    inputs: Sequence[Tensor],
    labels: Tensor,
    groups: Sequence[Hashable],
    recordings: Sequence[Hashable],
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return a row for each recording, or for each fragment where each class has one recording.

    Returns:
        Rows (rows, D), their labels, the part in which each is left out, -1 for none, and the
        number of what it is left out with.
    """
    parts = torch.tensor(leave_out(labels.tolist(), groups, recordings))
    named = left_out_units(labels.tolist(), groups, recordings)
    numbers = {unit: number for number, unit in enumerate(dict.fromkeys(named))}
    units = torch.tensor([numbers[unit] for unit in named])
    if bool((parts >= 0).any()):
        rows = torch.empty(len(inputs), inputs[0].shape[1], dtype=torch.float64)
        for row, features in zip(rows, inputs, strict=True):
            row.copy_(features[0].double().mean(dim=1))
        return rows, labels, parts, units
    fragments = torch.tensor([features.shape[-1] for features in inputs])
    rows = torch.cat([features[0].T for features in inputs]).cpu().double()
    labels, units = (torch.repeat_interleave(x, fragments) for x in (labels, units))
    return rows, labels, torch.arange(len(rows)) % PARTS, units


def _chosen(labels: Tensor, classes: int) -> tuple[Tensor, int]:
    """Return the numbers of at most 600 rows to choose settings on, evenly spread.

    They are drawn, each from its own part of all: every second row may be the same take of each
    recording.

    Of many classes so few rows of each would be left that nothing of it could be left out; then
    they are of every nth class, which comes second.
    """
    some, nth = torch.arange(len(labels)), 1
    if len(labels) > MAX_ROWS and LEAST_ROWS * classes > MAX_ROWS:
        nth = math.ceil(classes / SOME_CLASSES)
        some = some[labels % nth == 0]
    if len(some) > MAX_ROWS:
        seeded = torch.Generator().manual_seed(0)
        edges = torch.arange(MAX_ROWS + 1) * len(some) // MAX_ROWS
        within = torch.rand(MAX_ROWS, generator=seeded) * edges.diff()
        some = some[edges[:-1] + within.long()]
    return some, nth


def _count_units(labels: Tensor, units: Tensor, classes: int) -> Tensor:
    """Return the number of different units of each class (classes,)."""
    pairs = {*zip(labels.tolist(), units.tolist(), strict=True)}
    return torch.tensor([label for label, _ in pairs]).bincount(minlength=classes)


def _factors(one: float | None, counts: Tensor) -> Tensor:
    """Return by how much the scores of each class are enlarged (classes,), at least 1.

    Args:
        one: Reliability of the score that one unit gives; None enlarges none.
        counts: Units (classes,) of each class.
    """
    if one is None:
        return torch.ones(len(counts)).double()
    kept = reliability_of_means(one, counts.clamp(max=MANY))
    return kept.max() / kept


def _spread(inputs: Sequence[Tensor]) -> Tensor:
    """Return deviations (fragments, D) of some fragments from the means of their recordings."""
    some = [x[0] for x in inputs if x.shape[-1] > 1]
    step = math.ceil(sum(x.shape[1] for x in some) / MAX_FRAGMENTS)
    parts, before = [torch.zeros(0, inputs[0].shape[1]).double()], 0
    for x in some:
        wanted = slice(-before % step, None, step)
        if wanted.start < x.shape[1]:
            parts.append((x[:, wanted] - x.mean(dim=1, keepdim=True)).T.cpu().double())
        before += x.shape[1]
    return torch.cat(parts)


def _left_out(scores: Callable[[Tensor], Tensor], parts: Tensor, classes: int) -> Tensor:
    """Return the scores (rows, classes) of each row by a fit without its part, else 0.

    Args:
        scores: Gives the scores of all rows by a fit to those that are marked.
        parts: (rows,) part in which each row is left out; -1 for none.
        classes: Number of classes.
    """
    left_out = torch.zeros(len(parts), classes).double()
    for part in {*parts[parts >= 0].tolist()}:
        out = parts == part
        left_out[out] = scores(~out)[out]
    return left_out


def _sharpness(left_out: Tensor, labels: Tensor, parts: Tensor, about: float) -> float:
    """Return the scale under which left-out scores (rows, classes) are as confident as correct.

    Args:
        left_out: Scores of each row by a fit without its part.
        labels: (rows,) class indices.
        parts: (rows,) part in which each row is left out; -1 for none.
        about: A tenth to ten times of which it is.
    """
    scores = [*(about * left_out[parts >= 0][:, :, None])]
    return about / fit_temperature(scores, labels[parts >= 0].tolist())


def _share(scores: Tensor, label: int) -> float:
    """Return the mean score of a class in (rows, classes), as a share of that of the targets."""
    return float((scores[:, label] - scores.mean(dim=1)).mean() / (1 - 1 / scores.shape[1]))


def _enlarged(scores: Tensor, factors: Tensor) -> Tensor:
    """Return scores (classes, ...) around their mean times the factors of the classes."""
    return (scores - scores.mean(dim=0)) * factors.reshape(-1, *[1] * (scores.dim() - 1))


def fit_temperature(logits: Sequence[Tensor], labels: Sequence[int]) -> float:
    """Return the temperature under which mean probabilities over fragments fit the labels best.

    It minimises the cross entropy against labels that are softened as Platt (1999) does: with n
    samples the true class has (n + 1) / (n + 2), and the others share the rest. A network
    that errs on none of a few samples would otherwise be made infinitely sure.

    Args:
        logits: (classes, fragments) of each sample.
        labels: True class of each.

    Returns:
        From 0.1 to 10.
    """
    classes, count = len(logits[0]), len(labels)
    rest = 1 / (count + 2)
    target = torch.full((count, classes), rest / (classes - 1), dtype=torch.float64)
    target[torch.arange(count), torch.tensor(labels)] = 1 - rest

    def loss(log_temperature: float) -> float:
        scaled = [(scores.cpu().double() / 10**log_temperature).softmax(dim=0) for scores in logits]
        means = [shares.sum(dim=1) / shares.shape[1] for shares in scaled]
        return float(-(target * torch.stack(means).clamp_min(1e-300).log()).sum() / count)

    return float(10 ** scipy.optimize.minimize_scalar(loss, bounds=(-1, 1), method="bounded").x)
