"""Class scores of fragments whose classes are planes: what a material does as conditions change.

With speed and force the spectrum of a texture moves, and each texture's in directions of its own.
A line between classes knows none of that; a Gaussian for each class that is long in a few
directions does: probabilistic principal components of each class (Tipping and Bishop 1999).
"""

import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple, cast

import torch
from torch import Tensor, nn

from tex_lightning.networks.blocks import FittedLater
from tex_lightning.networks.line_fit import SHARPNESS, LeftOutScores
from tex_lightning.networks.rows import count_units
from tex_lightning.networks.temperature import sharpness_of

DIRECTIONS = 2  # in which a class reaches far: a stroke varies in speed and force
POOLED = 12.0  # fragments that the scatter of all classes together counts for, in each of them
LARGEST = 48  # directions of the features that are used
MIN_VARIANCE = 1e-3  # between neighbouring fragments, as a share of the mean over the features
CLEARLY = 3.0  # standard errors of how many more recordings are right
MIN_UNITS = 4  # of the usual class, that were left out apart


class Fitted(NamedTuple):
    """Gaussians of the classes, after a projection to d directions.

    Attributes:
        projection: (d, D), after which neighbouring fragments scatter alike in every direction.
        centre: (d, 1), projected mean that is taken off.
        means: (classes, d).
        directions: (classes, DIRECTIONS, d) in which each class reaches far, orthonormal.
        narrow: (classes, DIRECTIONS), precision along them less that along the others.
        precision: (classes,), along all others.
        offset: (classes,), of the logarithm of the density.
    """

    projection: Tensor
    centre: Tensor
    means: Tensor
    directions: Tensor
    narrow: Tensor
    precision: Tensor
    offset: Tensor

    def scores(self, x: Tensor) -> Tensor:
        """Map features (..., D, L) to logarithms of densities (..., classes, L)."""
        z = self.projection @ x - self.centre
        far = z.square().sum(dim=-2, keepdim=True) - 2 * (self.means @ z)
        far = far + self.means.square().sum(dim=1)[:, None]
        along = self.directions * self.narrow.abs().sqrt()[:, :, None]  # narrow is never above 0
        places = (along * self.means[:, None]).sum(dim=2)[:, :, None]
        steps = [(along[:, k] @ z - places[:, k]).square() for k in range(along.shape[1])]
        far = self.precision[:, None] * far - torch.stack(steps).sum(dim=0)
        return self.offset[:, None] - far / 2


class ClassPlanes(FittedLater):
    """Score fragments by the logarithm of each class's density, once it was found to be better."""

    def __init__(self, classes: int, bands: int) -> None:
        super().__init__(
            projection=("d", bands), centre=("d", 1), means=(classes, "d"),
            directions=(classes, "far", "d"), narrow=(classes, "far"),
            precision=(classes,), offset=(classes,),
        )  # fmt: skip
        self.bands = bands

    def forward(self, x: Tensor) -> Tensor:
        """Map features (B, D, M, N) to class scores before softmax (B, classes, M, N)."""
        fitted = Fitted(*map(self.get_buffer, Fitted._fields))
        scores = fitted.scores(x.flatten(2))
        return scores.reshape(*scores.shape[:2], *x.shape[2:])

    def fit(self, fitted: Fitted, sharpness: float) -> None:
        """Use these classes, their scores times ``sharpness``."""
        sharper = ("narrow", "precision", "offset")
        self.take({n: x * (sharpness if n in sharper else 1) for n, x in fitted._asdict().items()})

    def fit_if_better(
        self,
        fragments: Callable[[slice, Iterable[int]], list[Tensor]],
        spans: Sequence[slice],
        labels: Tensor,
        line: LeftOutScores,
    ) -> None:
        """Use planes in some of the features, if they clearly beat a line.

        Recordings are left out of their fit as of that of the line. Where classes have few of them,
        what is left out is like what is fitted to, and tells nothing of how far a class reaches.

        Args:
            fragments: Returns these features of recordings by their numbers, (L, size of the span)
                float64 each.
            spans: Features that planes may be in.
            labels: (recordings,) class indices.
            line: What the line gave for left-out recordings.
        """
        classes = line.scores.shape[1]
        units = count_units(line.labels, line.units, classes)
        ideal = nn.functional.one_hot(line.labels, classes)
        if units.median() < MIN_UNITS or not _gain(ideal, line) > CLEARLY:
            return
        tried = [left_out_planes(fragments(span, line.numbers.tolist()), line) for span in spans]
        gains = [_gain(scores, line) for scores in tried]
        best = max(range(len(tried)), key=gains.__getitem__, default=None)
        if best is None or gains[best] <= CLEARLY:
            return
        fitted = fit_planes(fragments(spans[best], range(len(labels))), labels, classes)
        wide = torch.zeros(len(fitted.projection), self.bands).double()
        wide[:, spans[best]] = fitted.projection
        sharpness = sharpness_of(tried[best], line.labels, line.parts, 1 / SHARPNESS)
        self.fit(fitted._replace(projection=wide), sharpness)


def fit_planes(fragments: Sequence[Tensor], labels: Tensor, classes: int) -> Fitted:
    """Fit the Gaussian of every class to the fragments of its recordings.

    Where a class has few fragments, its scatter is that of all classes together.

    Args:
        fragments: (L, D) float64 of each recording, of two fragments and more at least once.
        labels: (recordings,) class indices.
        classes: Number of classes.
    """
    counts = torch.tensor([len(x) for x in fragments])
    labels, rows = labels.repeat_interleave(counts), torch.cat([*fragments])
    projection = _projection(fragments, rows)
    centre = projection @ rows.mean(dim=0)
    rows = rows @ projection.T - centre
    members = nn.functional.one_hot(labels, classes).double()
    number = members.sum(dim=0)
    means = members.T @ rows / number.clamp_min(1)[:, None]
    scatter = _class_scatter(rows - means[labels], labels, number)
    variances, vectors = torch.linalg.eigh(scatter)
    taken = min(DIRECTIONS, len(projection) - 1)
    rest, far = variances.tensor_split([len(projection) - taken], dim=1)
    usual = rest.mean(dim=1)
    offset = -(far.log().sum(dim=1) + rest.shape[1] * usual.log()) / 2
    directions = vectors[:, :, len(projection) - taken :].transpose(1, 2)
    narrow = 1 / far - 1 / usual[:, None]
    return Fitted(projection, centre[:, None], means, directions, narrow, 1 / usual, offset)


def _class_scatter(apart: Tensor, labels: Tensor, number: Tensor) -> Tensor:
    """Return the covariance (classes, d, d) of each class, mixed with that of all together.

    Args:
        apart: Rows (rows, d) less the mean of their class.
        labels: (rows,) class indices.
        number: Rows of each class (classes,).
    """
    pooled = apart.T @ apart / max(1, len(apart) - len(number))
    members = [apart[labels == label] for label in range(len(number))]
    own = torch.stack([rows.T @ rows for rows in members])
    return (own + POOLED * pooled) / (number + POOLED)[:, None, None]


def _projection(fragments: Sequence[Tensor], rows: Tensor) -> Tensor:
    """Return the largest directions (d, D) of rows in units of the scatter between neighbours."""
    steps = torch.cat([x.diff(dim=0) for x in fragments])
    noise = steps.T @ steps / (2 * max(1, len(steps)))
    least = MIN_VARIANCE * noise.diagonal().mean().clamp_min(torch.finfo(rows.dtype).tiny)
    variances, directions = torch.linalg.eigh(noise + least * torch.eye(len(noise)).double())
    white = directions * variances.rsqrt()
    if len(white) <= LARGEST:
        return cast(Tensor, white.T)
    _, main = torch.linalg.eigh(((rows - rows.mean(dim=0)) @ white).T.cov())
    return cast(Tensor, (white @ main[:, -LARGEST:]).T)


def left_out_planes(fragments: Sequence[Tensor], line: LeftOutScores) -> Tensor:
    """Return mean scores (recordings, classes) by a fit without each one's part, else 0.

    Args:
        fragments: (L, D) float64 of each recording that the line was tried on.
        line: How these are left out.
    """
    labels, parts, scores = line.labels, line.parts, torch.zeros_like(line.scores)
    for part in {*parts[parts >= 0].tolist()}:
        rest, out = parts != part, (parts == part).nonzero()[:, 0].tolist()
        others = [*itertools.compress(fragments, rest.tolist())]
        fitted = fit_planes(others, labels[rest], scores.shape[1])
        for number in out:
            scores[number] = fitted.scores(fragments[number].T).mean(dim=1)
    return scores


def _gain(scores: Tensor, line: LeftOutScores) -> float:
    """Return how many more left-out rows are right by scores than by a line's, in standard errors.

    Scores are (rows, classes), of the rows that the line was tried on.
    """
    some = line.parts >= 0
    right, other = (x.argmax(dim=1)[some] == line.labels[some] for x in (scores, line.scores))
    gained, lost = int((right & ~other).sum()), int((other & ~right).sum())
    return (gained - lost) / math.sqrt(max(1, gained + lost))
