"""LinearNet: class scores that are linear in the features of a fragment, fitted in closed form.

A rule with one weight for each feature needs few recordings of a class, and fitting it takes a
moment: ridge regression of the classes on the features, as in MiniRocket (Dempster et al. 2021).
"""

import statistics
from collections.abc import Collection, Iterable, Iterator, Sequence
from functools import partial
from itertools import compress, product
from typing import Annotated, cast

import torch
from torch import Tensor, nn

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import Head, Level
from tex_lightning.networks.line import REACH, LineOrPlanes
from tex_lightning.networks.line_fit import Line, fit_line
from tex_lightning.networks.planes import DIRECTIONS
from tex_lightning.networks.range import RangeGate, gated_groups
from tex_lightning.networks.ridge import whitened
from tex_lightning.networks.rows import Examples, LeftOut, Pair, training_rows, unit_changes

MIN_DEVIATION = 1e-3  # of a feature; one that hardly varies says nothing
OPTIONAL = (("power",), ("axes", "axes_power"))  # kinds of blocks, left out unless they help
GAIN = {"power", "axes_power", "level"}  # kinds of blocks that depend on the gain
CURVED = "mean"  # kind of block in which classes can be planes
WHITENED = "level"  # kind of block whose features vary together, as under another pressure
SHORT_PART = 0.25  # of the fragments of a usual training recording: with fewer it is short


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
    recording (:class:`~tex_lightning.networks.range.RangeGate`).

    Another sensor, clock or hand changes the features of a stroke, and must not change its class.
    So the scores hardly follow the directions in which disturbed recordings differ from themselves:
    their mean square is added to the ridge (Simard et al. 1992, Tangent prop; Bishop 1995, Training
    with noise is equivalent to Tikhonov regularization). Where fragments are the rows, it counts
    the root of their number in a recording as often.

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
        self.level_features = sum(size for kind, size in self.blocks if kind == WHITENED)
        self.register_buffer("mean", torch.zeros(bands, 1, 1))
        self.register_buffer("scale", torch.ones(bands, 1, 1))
        self.register_buffer("whitening", torch.eye(self.level_features))
        self.head = Head(nn.Sequential(), bands, classes, dropout=0)
        groups = gated_groups(self.blocks, [-1] * bands if bins is None else bins)
        self.head.scores = LineOrPlanes(RangeGate(groups), self.score_layer)

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
        if self.level_features:
            x[:, -self.level_features :, 0] = self.whitening.T @ x[:, -self.level_features :, 0]
        scores: Tensor = self.head(x, level)
        return scores.squeeze(2)

    @property
    def cuts(self) -> bool:
        """Whether :meth:`fit` makes use of pieces."""
        return not self.level_features

    @property
    def sizes(self) -> Tensor:
        """Number of features of each block."""
        return torch.tensor([size for _, size in self.blocks])

    @property
    def score_layer(self) -> nn.Conv2d:
        """FC3, the only layer."""
        return self.head.score_layer

    @property
    def scores(self) -> LineOrPlanes:
        """What FC3 is the usual line of."""
        return cast(LineOrPlanes, self.head.scores)

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
        fragment where every class has but one recording, which tells nothing of the next one.

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
        examples = Examples(
            inputs, labels.cpu(), groups, recordings or range(len(labels)), pieces, disturbed
        )
        rows, labels, left_out = training_rows(examples)
        mean, deviation = rows.mean(dim=0), rows.std(dim=0, correction=0)
        scale = torch.where(deviation > MIN_DEVIATION, 1 / deviation, 0)
        scaled = scale * self.block_scale
        rows = rows.sub_(mean).mul_(scaled)
        changes = unit_changes(disturbed, scaled, self.level_features)
        # a recording's fragments resemble each other: in effect there are about so many of them
        weight = (len(rows) / len(inputs)) ** 0.5
        line, gainless = self._lines(rows, labels, left_out, changes, weight)
        self.mean.copy_(mean[:, None, None])
        self.scale.copy_(scale[:, None, None])
        self.whitening.copy_(line.whitening)
        weights, bias = line.layer(self.block_scale)
        self.score_layer.weight.copy_(weights[:, :, None, None])
        self.score_layer.bias = nn.Parameter(bias.to(self.score_layer.weight))
        rows = whitened(rows, line.whitening).div_(self.block_scale)  # many fill the memory
        self._fit_exceptions(examples, rows, line, gainless)

    @property
    def block_scale(self) -> Tensor:
        """Factor of each standardised feature (D,), after which all blocks count alike."""
        return torch.repeat_interleave(self.sizes.double().rsqrt(), self.sizes)

    def _fit_exceptions(
        self, examples: Examples, rows: Tensor, line: Line, gainless: Line | None
    ) -> None:
        """Fit what scores recordings that are unlike the usual, and what beats the line.

        Rows are standardised features (rows, D) of recordings, or of their fragments, and
        ``gainless`` is the line of those that no gain changes.
        """
        usual = statistics.median(features.shape[-1] for features in examples.inputs)
        whole = len(rows) == len(examples.inputs)  # else fragments
        scores, short = self.scores, int(usual * SHORT_PART)
        scores.gate.limits.copy_(scores.gate.limits_of(rows))
        scores.gate.fragments.fill_(usual if whole else 1)
        scores.forget()
        if whole and usual >= 2:
            self._fit_planes(examples, line)
        if not scores.is_linear:
            return
        if gainless:
            scores.gainless.fit(line, gainless, rows, self.block_scale)
            if whole and scores.gainless.in_use:
                strength = scores.gainless.direction.to(rows)
                scores.odd.fit(strength, gainless, rows, self.block_scale)
        if not self.level_features:  # which tell much by their range
            self._fit_range(examples, rows, short)
        if self.cuts and short:
            self._fit_short(examples, short)
        self._fit_reach(examples, rows)

    def _lines(
        self, rows: Tensor, labels: Tensor, left_out: LeftOut, changes: Tensor, weight: float
    ) -> tuple[Line, Line | None]:
        """Fit the line to scaled rows (rows, D), and one without what depends on the gain.

        ``weight`` is that of the changes.

        Raises:
            UserError: If all rows are the same.
        """
        fitted = partial(
            fit_line, labels=labels, left_out=left_out, classes=self.classes,
            strength=self.strength, shrinkage=self.shrinkage, changes_weight=weight,
        )  # fmt: skip
        varies = rows.any(dim=0)
        if not (subsets := [*self._subsets(varies)]):
            raise UserError(
                "All training recordings are alike: no feature differs between them, as of "
                "silence, constant signals or one recording that is given for all; check them."
            )
        line = fitted(rows, changes=changes, subsets=subsets, level_features=self.level_features)
        others = slice(rows.shape[1] - self.level_features)
        subsets = [used[others] for used in self._subsets(varies, without=GAIN)]
        if not self.level_features or not subsets:
            return line, None
        changes = changes[:, others]
        return line, fitted(rows[:, others], changes=changes, subsets=subsets, level_features=0)

    def _fit_range(self, examples: Examples, rows: Tensor, short: int) -> None:
        """Fit the range of recordings of more than ``short`` fragments to rows (rows, D)."""
        if len(rows) != len(examples.inputs):
            every = torch.split(rows, [features.shape[-1] for features in examples.inputs])
            rows = torch.stack([fragments.mean(dim=0) for fragments in every])
        self.scores.range.fit(rows, len({*examples.recordings}), short)

    def _fit_planes(self, examples: Examples, line: Line) -> None:
        """Fit planes of the classes in one of the blocks of means, if they clearly beat the line.

        Each of the recordings was a row of the line.
        """
        mean, scale = (x.double().cpu()[:, :, 0] for x in (self.mean, self.scale))
        ends = self.sizes.cumsum(dim=0).tolist()
        spans = [
            slice(end - size, end)
            for end, (kind, size) in zip(ends, self.blocks, strict=True)
            if kind == CURVED and size > DIRECTIONS and scale[end - size : end].any()
        ]

        def cut(span: slice, some: Iterable[int]) -> list[Tensor]:
            chosen = (examples.inputs[number][0, span] for number in some)
            return [((x.double().cpu() - mean[span]) * scale[span]).T for x in chosen]

        self.scores.planes.fit_if_better(cut, spans, examples.labels, line.left_out)

    def _fit_short(self, examples: Examples, short: int) -> None:
        """Fit the line of recordings of up to ``short`` fragments to pieces beside whole ones."""
        with_pieces = examples.with_pieces()
        if with_pieces is None:
            return
        other = LinearNet(
            self.classes, bands=len(self.mean), blocks=self.blocks, strength=self.strength,
            shrinkage=self.shrinkage,
        )  # fmt: skip
        other.fit(*with_pieces)
        weight, bias = self._translated(other)
        self.scores.short.take({"weight": weight, "bias": bias, "most": torch.tensor(float(short))})

    def _fit_reach(self, examples: Examples, rows: Tensor) -> None:
        """Fit how far out recordings lie that scores are sure of, to pieces or rows (rows, D)."""
        reach, gate, share = self.scores.reach, self.scores.gate, self.block_scale.square()
        lengths: dict[int, float] = {}  # of the longest piece of each
        for number, piece in examples.pieces:
            mean = self.features(piece.mean(dim=2)[None, :, :, None], "fc2")
            inside = gate(mean[..., None], (mean, piece.shape[2])).double().flatten()
            lengths[number] = max(lengths.get(number, 0.0), float(inside.square() @ share))
        if lengths:
            reach.fit(torch.tensor([*lengths.values()]), share, 1)
        else:
            reach.fit(rows.square() @ share, share, REACH)

    def _translated(self, other: "LinearNet") -> tuple[Tensor, Tensor]:
        """Return the weights (classes, D, 1, 1) and biases that score alike by own features."""
        layer, scale = other.score_layer, self.scale.double().flatten()
        weight = layer.weight.double().flatten(1) * other.scale.double().flatten()
        shift = weight @ (self.mean - other.mean).double().flatten()
        weight = torch.where(scale > 0, weight / scale, 0)[:, :, None, None]
        return weight, cast(Tensor, layer.bias).double() + shift

    def _subsets(self, varies: Tensor, without: Collection[str] = ()) -> Iterator[Tensor]:
        """Yield which features (D,) are used: with every choice of optional blocks, none first.

        Those of the kinds ``without`` never are; some feature always ``varies`` (D,).
        """
        blocks = {kind for kind, _ in self.blocks}.difference(without)
        optional = [kinds for kinds in OPTIONAL if blocks.intersection(kinds)]
        for chosen in product((False, True), repeat=len(optional)):
            unused = compress(optional, (not use for use in chosen))
            kinds = blocks.difference(*unused)
            is_used = torch.tensor([kind in kinds for kind, _ in self.blocks])
            used = torch.repeat_interleave(is_used, self.sizes)
            if (used & varies).any():
                yield used.double()
