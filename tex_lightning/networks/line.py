"""What scores the fragments of a LinearNet: a gate, then a line, or what takes its place."""

from collections import OrderedDict
from typing import Any, cast

import torch
from torch import Tensor, nn
from torch.nn.functional import pad

from tex_lightning.core.devices import is_at_hand
from tex_lightning.networks.blocks import FittedLater, Head, score_layer_of
from tex_lightning.networks.line_fit import Line
from tex_lightning.networks.planes import ClassPlanes
from tex_lightning.networks.range import FeatureRange, RangeGate

BLOCK = 512  # positions that are scored at once
APART = 6.0  # deviations of strength, over the root of the rows, beyond the weakest and strongest
SUFFICES = 0.75  # of the left-out rows that are right with levels, for scores without
CHANCE = 0.25  # of the root of that number may be missing: about half a standard error
TOLD = 0.1  # of the mean squared length of a row: ridge of the strength that other features tell
SHORT, GAINLESS = "short", "gainless"  # names of the scores of other recordings
REACH = 3.0  # times the squared length of a usual row, up to which scores are taken as they are


class ShortLine(FittedLater):
    """Other linear scores for short recordings, whose features are noisier and not the same.

    Attributes:
        most: Fragments () of the longest recording that is short.
        limit: The same, without a wait for a device; 0 of none.
    """

    weight: Tensor
    bias: Tensor
    most: Tensor
    limit = 0.0

    def __init__(self, classes: int, bands: int) -> None:
        super().__init__(weight=(classes, bands, 1, 1), bias=(classes,), most=())

    def note(self) -> None:
        """Note the limit."""
        self.limit = float(self.most) if self.in_use else 0.0

    def forward(self, x: Tensor, long: nn.Conv2d, count: int) -> Tensor:
        """Return the class scores (B, classes, M, N) of a recording of so many fragments.

        While a fusion is trained on single fragments, they are those of a long one.

        Args:
            x: Features (B, D, M, N) that passed the gate.
            long: The layer of recordings of more than ``most``.
            count: Number of fragments; in an export it is known only at run time.
        """
        mine, others = (self.weight, self.bias), (long.weight, cast(Tensor, long.bias))
        if self.in_use and torch.compiler.is_exporting():  # both are less than a choice of weights
            return torch.where(self.most / count >= 1, weighed(x, *mine), weighed(x, *others))
        return weighed(x, *(mine if count <= self.limit and not self.training else others))


class GainlessLine(FittedLater):
    """Other linear scores for recordings that are weaker or stronger than all in training.

    Another gain of the sensor says nothing of the material, and they leave out what depends on it.

    Attributes:
        direction: (D,) whose product with the mean features is the strength of a recording.
        limits: Least and largest strength (2,) with which the usual scores are used.
    """

    weight: Tensor
    bias: Tensor
    direction: Tensor
    limits: Tensor

    def __init__(self, classes: int, bands: int) -> None:
        super().__init__(
            weight=(classes, bands, 1, 1), bias=(classes,), direction=(bands,), limits=(2,)
        )

    def fit(self, usual: Line, other: Line, rows: Tensor, block_scale: Tensor) -> None:
        """Use a line without what depends on the gain, if it tells the classes apart, too.

        Where levels alone tell them, as those of a pressure, no other scores take their place.

        Args:
            usual: The line of all features.
            other: That of the features before the levels.
            rows: (rows, D) training rows as the usual line gets them, the levels last.
            block_scale: (D,), as of a LinearNet.
        """
        correct, with_levels = other.left_out.correct, usual.left_out.correct
        if not correct or correct < SUFFICES * with_levels - CHANCE * with_levels**0.5:
            return
        levels = len(usual.whitening)
        before, last = len(block_scale) - levels, max(1, levels // 2)
        weights, bias = other.layer(block_scale[:before])
        mean = torch.cat((torch.zeros(levels - last), torch.full((last,), 1 / last))).double()
        direction = torch.linalg.solve(usual.whitening, mean)
        strengths = rows[:, before:] @ direction
        margin = APART * strengths.std(correction=0) / len(rows) ** 0.5
        self.take({
            "weight": pad(weights, (0, levels))[:, :, None, None],
            "bias": bias,
            "direction": pad(direction, (before, 0)),
            "limits": torch.stack((strengths.min() - margin, strengths.max() + margin)),
        })  # fmt: skip

    def forward(self, inside: Tensor, mean: Tensor, usual: Tensor, is_odd: Tensor) -> Tensor:
        """Return the class scores (B, classes, M, N), of usual recordings the usual ones.

        Args:
            inside: Features (B, D, M, N) that passed the gate.
            mean: (B, D, 1) of all fragments of the recording before the gate.
            usual: Usual scores of the same.
            is_odd: (B,) where neither is to be trusted alone; their mean is taken.
        """
        strength = mean.flatten(1) @ self.direction
        far = (strength < self.limits[0]) | (strength > self.limits[1])
        if is_at_hand(mean) and not (far | is_odd).any():
            return usual
        others = weighed(inside, self.weight, self.bias)
        odd = torch.where(is_odd[:, None, None, None], (others + usual) / 2, usual)
        return torch.where(far[:, None, None, None], others, odd)


class OddStrength(FittedLater):
    """Tell recordings whose strength is not what their other features tell.

    Materials differ in strength, so that another gain seldom leaves the range of all of them. But
    what no gain changes tells the material, and with it how strong it usually is; not where that
    lies farther out than all of the training.

    Attributes:
        direction: (D,) whose product with the mean features is their strength, less what is told.
        most: The largest such difference () of a training recording, in either direction, when the
            others told it.
        share: Of each feature in the squared length of those that tell it (D,).
        longest: The largest such length () of a training recording.
    """

    direction: Tensor
    most: Tensor
    share: Tensor
    longest: Tensor

    def __init__(self, bands: int) -> None:
        super().__init__(direction=(bands,), most=(), share=(bands,), longest=())

    def fit(self, strength: Tensor, other: Line, rows: Tensor, block_scale: Tensor) -> None:
        """Tell strength by a ridge regression on the features of the line without gain.

        Args:
            strength: (D,) whose product with a row is its strength.
            other: The line of the features that no gain changes, which are the first.
            rows: (rows, D) standardised rows, one a recording.
            block_scale: (D,), as of a LinearNet.
        """
        scale = block_scale[: len(other.weights)] * other.weights.any(dim=1)
        some, parts = other.left_out.numbers, other.left_out.parts
        features, values = rows[some, : len(scale)] * scale, rows[some] @ strength
        gram = features @ features.T
        gram.diagonal().add_((TOLD * gram.diagonal().mean()).clamp_min(1e-9))
        inverse = torch.linalg.inv(gram)
        dual, most = inverse @ values, values.new_zeros(())
        for part in {*parts[parts >= 0].tolist()}:  # what is left when they are left out
            out = parts == part
            left = torch.linalg.solve(inverse[out][:, out], dual[out])
            most = torch.maximum(most, left.abs().max())
        told, share = torch.zeros_like(strength), torch.zeros_like(strength)
        told[: len(scale)], share[: len(scale)] = dual @ features * scale, scale.square()
        longest = (rows.square() @ share).amax()
        learnt = strength - told, most, share, longest
        self.take(dict(zip(self.names, learnt, strict=True)))

    def forward(self, mean: Tensor) -> Tensor:
        """Return which recordings (B,) of mean features (B, D, 1) are so; none if not in use."""
        if not self.in_use:
            return torch.zeros(len(mean), dtype=torch.bool, device=mean.device)
        features = mean.flatten(1)
        is_usual = features.square() @ self.share <= self.longest
        return is_usual & ((features @ self.direction).abs() > self.most)


class ScoreReach(FittedLater):
    """Bring scores nearer to each other for recordings that lie farther out than the training.

    A line is the surer the longer the features are, and those of a recording that is shorter than
    any in training, or unlike them, are long because they are noisy. Labels stay as they are.

    Attributes:
        share: Of each feature in the squared length of a row (D,).
        longest: Squared length () up to which scores are taken as they are.
    """

    share: Tensor
    longest: Tensor

    def __init__(self, bands: int) -> None:
        super().__init__(share=(bands,), longest=())

    def fit(self, lengths: Tensor, share: Tensor, factor: float) -> None:
        """Take the median of squared lengths (rows,) times a factor; ``share`` is the attribute."""
        self.take({"share": share, "longest": factor * lengths.median()})

    def widened(self, rows: Tensor) -> dict[str, Tensor]:
        """Return the length up to which more rows (rows, D) are taken as they are, too."""
        if not self.in_use:
            return {}
        return {"longest": torch.maximum(self.longest, (rows.square() @ self.share).amax())}

    def forward(self, scores: Tensor, mean: Tensor) -> Tensor:
        """Return class scores (B, classes, positions), times at most one.

        Args:
            scores: The scores.
            mean: Mean features (B, D) of the whole recording that passed the gate.
        """
        length = mean.square() @ self.share
        factor = (self.longest / length.clamp_min(torch.finfo(length.dtype).tiny)).clamp(max=1)
        return scores * factor[:, None, None]


class LineOrPlanes(nn.Sequential):
    """Class scores of features that passed a gate: by a linear layer, or by planes where better.

    A recording that is unlike all in training is moved to their ``range``, and the gate takes out
    what is out of range in it. Then ``planes`` score it, if they are in use. If not, the layer
    does, or that of ``short`` recordings, or that of another gain (``gainless``), or its mean with
    that where the strength is ``odd``; and scores beyond the ``reach`` of the training are brought
    nearer to each other. The names of the parts are those of checkpoints.

    Args:
        gate: Takes features out that are out of range.
        layer: Linear scores; the last part, which other classes are added to.
    """

    range: FeatureRange
    planes: ClassPlanes
    short: ShortLine
    gainless: GainlessLine
    odd: OddStrength
    reach: ScoreReach

    def __init__(self, gate: RangeGate, layer: nn.Conv2d) -> None:
        count, bands = layer.out_channels, layer.in_channels
        sizes = count, bands
        parts = [("0", gate), ("range", FeatureRange(bands)), ("planes", ClassPlanes(*sizes))]
        parts += [(SHORT, ShortLine(*sizes)), (GAINLESS, GainlessLine(*sizes))]
        parts += [("odd", OddStrength(bands))]
        super().__init__(OrderedDict([*parts, ("reach", ScoreReach(bands)), ("1", layer)]))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take the state of a pickle; older ones know no odd strength."""
        super().__setstate__(state)  # type: ignore[no-untyped-call]  # no annotation
        if "odd" not in self._modules:
            layer = cast(nn.Conv2d, self._modules.pop("1"))  # which stays the last
            self._modules |= {"odd": OddStrength(layer.in_channels), "1": layer}

    def forget(self) -> None:
        """Use nothing beside gate and layer."""
        for part in self.children():
            if isinstance(part, FittedLater):
                part.take(None)

    @property
    def gate(self) -> RangeGate:
        """What takes features out that are out of range."""
        return cast(RangeGate, self[0])

    @property
    def layer(self) -> nn.Conv2d:
        """The usual line."""
        return cast(nn.Conv2d, self[-1])

    def forward(self, x: Tensor, whole: tuple[Tensor, int] | None = None) -> Tensor:
        """Map features (B, D, M, N) to class scores before softmax (B, classes, M, N).

        ``whole`` is what the gate takes (:class:`RangeGate`).
        """
        if whole is None:
            whole = x.flatten(2).mean(dim=2, keepdim=True), x[0, 0].numel()
        if not torch.compiler.is_exporting() and x.shape[-1] > BLOCK:
            return torch.cat([self(part, whole) for part in torch.split(x, BLOCK, dim=-1)], dim=-1)
        mean, count = whole
        is_bounded, positions = self.reach.in_use and not self.reach.training, x.shape[2:]
        if is_bounded:  # the mean passes the gate with the fragments, as the last of them
            x = torch.cat((x.flatten(2).mT, mean.mT), dim=1).mT[..., None]
        inside: Tensor = self.gate(self.range(x, whole), whole)
        if not self.is_linear:
            return cast(Tensor, self.planes(inside))
        scores: Tensor = self.short(inside, self.layer, count)
        if self.gainless.in_use and not self.training:
            scores = self.gainless(inside, mean, scores, self.odd(mean))
        if not is_bounded:
            return scores
        within: Tensor = self.reach(scores[:, :, :-1, 0], inside[:, :, -1, 0])
        return within.reshape(*within.shape[:2], *positions)

    @property
    def is_linear(self) -> bool:
        """Whether the score of a mean is the mean of the scores."""
        return not self.planes.in_use


def weighed(x: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
    """Return scores (B, classes, M, N) of features (B, D, M, N), which a convolution would copy.

    Args:
        x: Features, in any layout.
        weight: (classes, D, 1, 1).
        bias: (classes,).
    """
    scores = weight.flatten(1) @ x.flatten(2) + bias[:, None]
    return scores.reshape(x.shape[0], -1, *x.shape[2:])


def scores_from_fc2(
    network: nn.Module, features: Tensor, whole: tuple[Tensor, int] | None = None
) -> Tensor:
    """Return class scores (classes, positions) of FC2's features (D, positions).

    Args:
        network: A network with a ``score_layer``.
        features: Features of all positions of a recording, or of some of them.
        whole: If of some, the mean features (D,) of all positions of the recording, and their
            number.
    """
    if isinstance(head := getattr(network, "head", None), Head):
        arguments: list[Any] = [features[None, :, :, None]]
        if whole is not None and isinstance(head.scores, LineOrPlanes):
            arguments.append((whole[0][None, :, None], whole[1]))
        scores: Tensor = head.scores(*arguments)
        return scores[0, :, :, 0]
    layer: Any = score_layer_of(network)
    logits: Tensor = layer.weight.flatten(1) @ features + layer.bias[:, None]
    return logits
