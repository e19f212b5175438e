"""Statistics of a network's features: the mean of every class, and one shared covariance.

A checkpoint keeps the statistics of the mean embeddings of its training recordings. With them
classes are added without the old recordings, and unknown recordings are detected. A network in
closed form may also keep the embeddings themselves (:class:`TrainingRows`), to be fitted again.
"""

import math
from collections.abc import Hashable, Mapping, Sequence
from typing import Self

import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor, nn

MAX_RANK = 128  # directions of the covariance that are kept; the others share one variance
MAX_ROWS = 1000  # recordings that tell them, evenly spread; so many need as many squared products
BLOCK = 1000  # recordings that are taken at once as float64
MIN_VARIANCE = 1e-8  # of features that never vary
ROUNDING = 1e-12  # of a feature's mean square: its variance where it never varies
PRIOR = 3  # recordings, as which the whole variance of a feature counts within classes, too
MIN_RATIO = 0.1  # of the deviation between classes to that within them
NO_REACH = 2.0**40  # a distance that no recording has, and float32 and checkpoints can hold


class FeatureStatistics(nn.Module):
    """Means of all classes and one covariance within them, as of a linear discriminant analysis.

    The covariance is that of the recordings' mean features about the mean of their class. Features
    are divided by their scales first, so that among thousands those that hardly differ between
    classes do not dominate. The covariance is then shrunk towards a multiple of the identity:
    sum_i v_i d_i d_i^T + rest (1 - sum_i d_i d_i^T), with orthonormal directions d_i. This form
    needs little memory for thousands of features, and is never singular.

    Args:
        classes: Number of classes.
        features: Length of a feature vector, D.
        rank: Number of directions.

    Attributes:
        means: (classes, D), the mean features of each class.
        counts: (classes,) int64, recordings behind each mean.
        scales: (D,) above 0: the deviation of each feature within the classes, divided by the ratio
            of its deviation between the classes to that within them.
        directions: (rank, D), orthonormal, of the features divided by their scales.
        variances: (rank,) along the directions, above 0.
        rest: () variance along every other direction, above 0.
        reach: () above 0: distance to the closest class up to which recordings are like those of
            the training; :data:`NO_REACH` if it is not known.
        error: () share of such recordings whose closest class is a wrong one, 0 to 1.
        white: (classes, D), the means about their centre, whitened.
        centre: (D,), the mean of all classes.
        lengths: (classes,), those of ``white``.

    Example:
        >>> import torch
        >>> from tex_lightning.classifier.statistics import FeatureStatistics
        >>> rows = torch.tensor([[0.0, 0.0], [0.0, 2.0], [9.0, 0.0], [9.0, 2.0]])
        >>> statistics = FeatureStatistics.of(rows, torch.tensor([0, 0, 1, 1]), classes=2)
        >>> statistics.means
        tensor([[0., 1.],
                [9., 1.]])
        >>> statistics.novelty(torch.tensor([9.0, 1.0]))
        tensor(0.)
    """

    means: Tensor
    counts: Tensor
    scales: Tensor
    directions: Tensor
    variances: Tensor
    rest: Tensor
    reach: Tensor
    error: Tensor
    white: Tensor
    centre: Tensor
    lengths: Tensor

    def __init__(self, classes: int, features: int, rank: int) -> None:
        super().__init__()
        self.register_buffer("means", torch.zeros(classes, features))
        self.register_buffer("counts", torch.zeros(classes, dtype=torch.long))
        self.register_buffer("scales", torch.ones(features))
        self.register_buffer("directions", torch.zeros(rank, features))
        self.register_buffer("variances", torch.ones(rank))
        self.register_buffer("rest", torch.ones(()))
        self.register_buffer("reach", torch.tensor(NO_REACH))
        self.register_buffer("error", torch.zeros(()))
        self.register_buffer("white", torch.zeros(classes, features), persistent=False)
        # what every recording is compared with, computed once: it reads the means of all classes
        self.register_buffer("centre", torch.zeros(features), persistent=False)
        self.register_buffer("lengths", torch.zeros(classes), persistent=False)

    @classmethod
    def of(cls, features: Tensor, labels: Tensor, classes: int) -> Self:
        """Compute statistics of features (recordings, D) with class indices (recordings,).

        Every class occurs. If none has two recordings, the covariance is that of the class means.
        Means and scales are computed from all recordings, directions from a thousand at most.
        """
        rows, labels = features.cpu(), labels.cpu()
        counts, size = labels.bincount(minlength=classes), rows.shape[1]
        sums = torch.zeros(classes, size, dtype=torch.float64)
        for block, kinds in zip(*(torch.split(x, BLOCK) for x in (rows, labels)), strict=True):
            sums.index_add_(0, kinds, block.double())
        centre, means = sums.sum(dim=0) / len(rows), sums / counts[:, None]
        freedom, around = len(rows) - classes, means
        if freedom < 1:
            freedom, around = max(1, classes - 1), centre.expand_as(means)
        whole = _squares(rows, labels, centre.expand_as(means)) / len(rows)
        scales = _scales(whole, _squares(rows, labels, around), centre, freedom)
        step = math.ceil(len(rows) / MAX_ROWS)
        some = (rows[::step] - around[labels[::step]]) / scales
        spread, directions, total, squared = _principal(some)
        variances, rest = _shrunk(spread, total, squared, math.ceil(freedom / step), size)
        state = {"means": means, "counts": counts, "scales": scales}
        state |= {"directions": directions[: len(variances)], "variances": variances, "rest": rest}
        return cls.from_state(state)

    @classmethod
    def from_state(cls, state: dict[str, Tensor]) -> Self:
        """Make statistics of the sizes of a stored state, and load it.

        Without ``scales``, as earlier checkpoints have them, all features weigh the same; without
        ``reach`` every recording is like the training.

        Raises:
            KeyError: If a tensor is missing.
            RuntimeError: If their sizes do not fit.
            ValueError: If a tensor has another number of axes.
        """
        classes, features = state["means"].shape
        statistics = cls(classes, features, len(state["directions"]))
        later = {name: getattr(statistics, name) for name in ("scales", "reach", "error")}
        statistics.load_state_dict({**later, **state})
        means = statistics.means
        statistics.centre.copy_(means.mean(dim=0))
        statistics.white.copy_(statistics.whiten(means - statistics.centre))
        statistics.lengths.copy_(statistics.white.norm(dim=-1))
        return statistics

    def with_classes(self, means: Tensor, counts: Tensor) -> Self:
        """Return statistics with more classes: means (added, D) of so many recordings each."""
        more = {"means": torch.cat([self.means, means]), "counts": torch.cat([self.counts, counts])}
        return self.from_state({**self.state_dict(), **more})

    def draw(self, count: int, generator: torch.Generator) -> Tensor:
        """Draw features (classes, count, D) that recordings of each class may have.

        They come from a Gaussian wider than the covariance, since the mean of n recordings has an
        error itself, of 1/n of the covariance.
        """
        shape = (len(self.means), count, self.means.shape[1])
        noise = torch.randn(shape, generator=generator).to(self.means)
        along, least = noise @ self.directions.T, self.rest.sqrt()
        noise = least * noise + (along * (self.variances.sqrt() - least)) @ self.directions
        noise *= self.scales
        wider = (1 + 1 / self.counts).sqrt()[:, None, None]
        return self.means[:, None] + wider * noise

    def whiten(self, features: Tensor) -> Tensor:
        """Whiten features (..., D): their covariance becomes the identity."""
        return self._decorrelate(features / self.scales)

    def weights_before(self, weights: Tensor) -> Tensor:
        """Return weights (..., D) that score features as ``weights`` score whitened ones."""
        return self._decorrelate(weights) / self.scales

    def _decorrelate(self, x: Tensor) -> Tensor:
        """Multiply (..., D) by the symmetric root of the inverse covariance of scaled features."""
        along = x @ self.directions.T
        scale, least = self.variances.rsqrt(), self.rest.rsqrt()
        return least * x + (along * (scale - least)) @ self.directions

    def novelty(self, features: Tensor) -> Tensor:
        """Return the novelty (...) of features (..., D) of whole recordings, 0 to 2.

        It is one minus the cosine to the closest class mean, after centring on the mean of all
        classes and whitening by the covariance: 0 in the direction of a class, 1 at a right angle
        to it. It detects unknown classes better than the distance does, whose scale varies between
        recordings (docs/calibration.md).
        """
        point = self.whiten(features - self.centre)
        lengths = point.norm(dim=-1, keepdim=True) * self.lengths
        cosines: Tensor = (point @ self.white.T) / lengths.clamp(min=MIN_VARIANCE)
        return 1 - cosines.amax(dim=-1).clamp(max=1)  # rounding may pass it

    def nearest(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return the whitened distance of features (..., D) to the closest class, and which: (...).

        It is computed by matrix products: differences from all classes would take memory of
        classes times recordings times features.
        """
        point = self.whiten(features - self.centre)
        halves = self.white.square().sum(dim=1) / 2
        closest = (halves - point @ self.white.T).argmin(dim=-1)
        return (point - self.white[closest]).norm(dim=-1), closest

    @property
    def has_reach(self) -> bool:
        """Whether it is known how far recordings like the training lie from their class."""
        return float(self.reach) < NO_REACH

    def reliability(self, features: Tensor) -> Tensor:
        """Return the reliability (...) of features (..., D) of whole recordings, 0 to 1.

        It is 1 up to a distance of :attr:`reach` from the closest class. Beyond, it falls with the
        square of the distance, as the weight of a difference does under a Gaussian whose deviation
        is widened to reach the recording.
        """
        distance = self.nearest(features)[0].clamp(min=MIN_VARIANCE)
        share: Tensor = (self.reach / distance).square()
        return share.clamp(max=1)


class TrainingRows(nn.Module):
    """Mean embeddings of the training recordings with their classes and groups.

    They are kept in half precision, which is exact to a thousandth of the deviation of a
    standardised feature. 1,000 recordings take 9 to 22 MB.

    Attributes:
        features: (recordings, D) float16, the mean embedding of each recording.
        labels: (recordings,) int64 class indices.
        groups: (recordings,) int64, equal for what was recorded together.
    """

    features: Tensor
    labels: Tensor
    groups: Tensor

    def __init__(self, recordings: int, features: int) -> None:
        super().__init__()
        self.register_buffer("features", torch.zeros(recordings, features, dtype=torch.float16))
        self.register_buffer("labels", torch.zeros(recordings, dtype=torch.long))
        self.register_buffer("groups", torch.zeros(recordings, dtype=torch.long))

    @classmethod
    def of(cls, features: Tensor, labels: Tensor, groups: Sequence[Hashable]) -> Self:
        """Keep features (recordings, D) of recordings with these class indices and groups."""
        numbers = {group: number for number, group in enumerate(dict.fromkeys(groups))}
        largest = torch.finfo(torch.float16).max
        state = {
            "features": features.clamp(-largest, largest),
            "labels": labels,
            "groups": torch.tensor([numbers[group] for group in groups]),
        }
        return cls.from_state(state)

    @classmethod
    def from_state(cls, state: Mapping[str, Tensor]) -> Self:
        """Make rows of the sizes of a stored state, and load it.

        Raises:
            RuntimeError: If sizes do not fit, or a tensor is missing.
            ValueError: If the features have another number of axes.
        """
        recordings, features = state["features"].shape
        rows = cls(recordings, features)
        rows.load_state_dict(dict(state))
        return rows

    def with_recordings(self, features: Tensor, labels: Tensor) -> Self:
        """Return rows with more recordings (added, D), each a group of its own."""
        first = int(self.groups.max()) + 1
        more = type(self).of(features, labels, range(len(labels)))
        old, new = self.state_dict(), more.state_dict()
        new["groups"] += first
        return self.from_state({name: torch.cat([old[name], new[name]]) for name in old})


def _squares(rows: Tensor, labels: Tensor, around: Tensor) -> Tensor:
    """Return squared deviations (D,) of rows (recordings, D), added up.

    Args:
        rows: The rows.
        labels: (recordings,) class indices.
        around: What rows of each class deviate from (classes, D), float64.
    """
    total = torch.zeros(rows.shape[1], dtype=torch.float64)
    for block, kinds in zip(*(torch.split(x, BLOCK) for x in (rows, labels)), strict=True):
        total += (block - around[kinds]).square().sum(dim=0)
    return total


def _scales(whole: Tensor, squares: Tensor, centre: Tensor, freedom: int) -> Tensor:
    """Return what each feature is divided by (D,), see :class:`FeatureStatistics`.

    Args:
        whole: Variance of each feature (D,).
        squares: Squared deviations of each from the means of the classes (D,), added up.
        centre: Mean of each (D,).
        freedom: Degrees of freedom of the deviations.
    """
    within = (squares + PRIOR * whole) / (freedom + PRIOR)
    varying = within > ROUNDING * (whole + centre.square())
    usual = within[varying].mean() if varying.any() else torch.ones_like(within[0])
    within = torch.where(varying, within, usual)  # any other value of a constant one is new
    ratios = (whole / within - 1).clamp(min=MIN_RATIO**2).sqrt()
    return within.sqrt() / ratios


def _principal(centred: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the largest squared singular values of rows (N, D), and their directions (rank, D).

    They are those of the smaller one of the two products of the rows with themselves. The sum of
    all squared singular values, and that of their squares, come third and fourth.
    """
    wide = len(centred) < centred.shape[1]
    square = centred @ centred.T if wide else centred.T @ centred
    largest = max(0, len(square) - MAX_RANK), len(square) - 1
    found = scipy.linalg.eigh(square.numpy(), subset_by_index=largest)
    values, vectors = map(torch.from_numpy, found)
    spread, first = values.flip(0).clamp_min(0), vectors.flip(1).T
    if wide:
        first = nn.functional.normalize(first @ centred, dim=1)
    return spread, first, square.trace(), square.square().sum()


def _shrunk(
    spread: Tensor, total: Tensor, squared: Tensor, freedom: int, size: int
) -> tuple[Tensor, Tensor]:
    """Return variances along the kept directions, and that along all others.

    Oracle approximating shrinkage (Chen et al. 2010) of a sample covariance towards its mean
    variance.

    Args:
        spread: Largest eigenvalues of the scatter, the largest first.
        total: Sum of all.
        squared: Sum of their squares.
        freedom: Degrees of freedom of the scatter: divided by them it is a sample covariance.
        size: Number of features.
    """
    mean, squares = total / freedom / size, squared / freedom**2 / size**2
    excess = (freedom + 1) * (squares - mean**2 / size)
    share = (squares + mean**2) / excess if excess > 0 else torch.ones_like(mean)
    share = share.clamp(max=1)
    rank = min(len(spread), freedom)
    kept = spread[:rank] / freedom
    left = (total / freedom - kept.sum()).clamp_min(0) / max(1, size - rank)
    shrunk = [(1 - share) * variance + share * mean for variance in (kept, left)]
    return shrunk[0].clamp(min=MIN_VARIANCE), shrunk[1].clamp(min=MIN_VARIANCE)
