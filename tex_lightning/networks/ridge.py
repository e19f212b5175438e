"""Ridge regression on subsets of the training rows, and linear discriminants.

Rows are few and features many, so everything is computed from products of rows. In each fit every
class weighs the same, however many rows it has.
"""

from typing import NamedTuple

import torch
from torch import Tensor, nn

LEVEL_SHRINKAGE = 0.001  # of the scatter of levels within classes, in their mean variance
BLOCK = 1000  # rows that are multiplied at once
MIN_VARIANCE = 1e-9  # of a direction of changes, as a share of the largest


class Products(NamedTuple):
    """Products of rows by the features in use.

    Attributes:
        kept: Which features are used (D,), 1 or 0.
        gram: Products (rows, rows) by all features but the levels.
        across: Rows along the directions in which changes lie, (rows, R).
        directions: These directions (R, D), orthonormal.
        variances: Mean square of the changes along each of them (R,).
        size: Weighted mean squared length of the centred rows, divided by their number.
    """

    kept: Tensor
    gram: Tensor
    across: Tensor
    directions: Tensor
    variances: Tensor
    size: float


class Ridge:
    """Ridge regressions of the classes on subsets of rows.

    Args:
        rows: (rows, D) float64.
        labels: (rows,) class indices.
        classes: Number of classes.
        changes: Changes (changes, D) of rows that are to change no score, whose mean square can be
            added to the ridge.
        levels: Number of the last features, which each fit brings to equal scatter within the
            classes of its rows.
    """

    def __init__(
        self, rows: Tensor, labels: Tensor, classes: int, changes: Tensor, levels: int = 0
    ) -> None:
        self.rows, self.labels, self.classes = rows, labels, classes
        self.changes, self.levels = changes, levels
        self.targets = nn.functional.one_hot(labels, classes).double()

    def weights(self, some: Tensor) -> Tensor:
        """Return weights (rows,) of sum 1, 0 outside ``some``.

        With all rows every class counts alike. A row counts no more for those of its class that are
        left out: of two recordings the other one would else be trusted like both.
        """
        counts = torch.bincount(self.labels, minlength=self.classes)
        weights = some / counts[self.labels].double()
        return weights / weights.sum()

    def products(self, kept: Tensor) -> Products:
        """Return the products of rows by the features in use, (D,) of 1 or 0."""
        rows, changes = self.rows * kept, self.changes * kept
        values, vectors = torch.linalg.eigh(changes @ changes.T)
        large = values > MIN_VARIANCE * values.max() if len(values) else values > 0
        directions = (vectors[:, large] / values[large].sqrt()).T @ changes
        weights = self.weights(torch.ones_like(self.labels, dtype=torch.bool))
        size = weights @ rows.square().sum(dim=1) - (weights @ rows).square().sum()
        others = rows[:, : rows.shape[1] - self.levels]
        across, variances = rows @ directions.T, values[large] / max(1, len(changes))
        return Products(
            kept, others @ others.T, across, directions, variances, float(size) / len(rows)
        )

    def scores(self, products: Products, penalty: float, ridge: float, some: Tensor) -> Tensor:
        """Return the scores (rows, classes) of all rows by a fit to some of them.

        Args:
            products: Of the features in use.
            penalty: Weight of the changes.
            ridge: The ridge.
            some: (rows,) whether each row is fitted to.
        """
        kernel = products.gram  # of rows, then as after what the fit does to their features
        if penalty:
            variances = penalty * products.variances
            kernel = (
                kernel - products.across * (variances / (ridge + variances)) @ products.across.T
            )
        if self.levels:
            levels = self.rows[:, -self.levels :]
            levels = levels @ equal_scatter(levels[some], self.labels[some])
            kernel = kernel + levels @ levels.T
        weights = self.weights(some)
        mean = kernel @ weights
        centred = kernel - mean - mean[:, None] + weights @ mean
        root, share = weights[some].sqrt()[:, None], weights @ self.targets
        inner = root * centred[some][:, some] * root.T + ridge * torch.eye(len(root)).double()
        dual = root * torch.linalg.solve(inner, root * (self.targets[some] - share))
        scores: Tensor = centred[:, some] @ dual + share
        return scores

    def solve(
        self, products: Products, penalty: float, ridge: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Fit to all rows.

        Returns:
            Weights (D, classes) of the features, whose levels have to be brought to equal scatter
            by the matrix (levels, levels), which is the third, and offset (classes,).
        """
        every = torch.ones_like(self.labels, dtype=torch.bool)
        weights, whitening = self.weights(every), torch.eye(self.levels).double()
        if self.levels:
            whitening = equal_scatter(self.rows[:, -self.levels :], self.labels)
        centre, share = weights @ self.rows, weights @ self.targets
        centre = whitened(centre[None] * products.kept, whitening)
        root, targets = weights.sqrt()[:, None], self.targets - share
        variances = penalty * products.variances

        def centred(some: slice) -> Tensor:
            rows = whitened(self.rows[some] * products.kept, whitening)
            return rows.sub_(centre).mul_(root[some])

        if len(self.rows) > self.rows.shape[1]:
            metric = (products.directions.T * variances) @ products.directions
            metric += ridge * torch.eye(len(metric)).double()
            moments = metric.new_zeros(len(metric), self.classes)
            for first in range(0, len(self.rows), BLOCK):
                some = slice(first, first + BLOCK)
                rows = centred(some)
                metric.addmm_(rows.T, rows)
                moments.addmm_(rows.T, root[some] * targets[some])
            solution = torch.linalg.solve(metric, moments)
        else:
            rows, targets = centred(slice(None)), root * targets
            shrunk, across = variances / (ridge + variances), rows @ products.directions.T
            inner = (
                rows @ rows.T - across * shrunk @ across.T + ridge * torch.eye(len(rows)).double()
            )
            solution = rows.T @ torch.linalg.solve(inner, targets)
            along = products.directions @ solution
            solution = solution - products.directions.T @ (shrunk[:, None] * along)
        return solution, share - (centre @ solution)[0], whitening


def whitened(rows: Tensor, whitening: Tensor) -> Tensor:
    """Return rows (rows, D) with the levels, the last ones, times a matrix (levels, levels)."""
    start = rows.shape[1] - len(whitening)
    if start == rows.shape[1]:
        return rows
    return torch.cat((rows[:, :start], rows[:, start:] @ whitening), dim=1)


def reliability_of_means(one: float, counts: Tensor) -> Tensor:
    """Return how reliable means of several measurements are (Spearman 1910; Brown 1910).

    Args:
        one: Reliability of one measurement, above 0 to 1.
        counts: Number of measurements.
    """
    return counts * one / (1 + (counts - 1) * one)


def reliability_of_one(ratio: float, fewer: float, more: float) -> float:
    """Return the reliability of one measurement from the ratio of those of two means.

    Args:
        ratio: Reliability of a mean of fewer, divided by that of a mean of more.
        fewer: Number of measurements in the first mean.
        more: Number in the second, larger.
    """
    scaled = ratio * more / fewer
    return (scaled - 1) / max(more - 1 - scaled * (fewer - 1), 1e-9)


def scatter(rows: Tensor, labels: Tensor, shrinkage: float) -> tuple[Tensor, Tensor]:
    """Return the means of the classes and the scatter within them, in which all weigh the same.

    Args:
        rows: (rows, D) float64.
        labels: (rows,) class indices.
        shrinkage: What is added to every variance, as a multiple of their mean.

    Returns:
        Means (classes, D), 0 of a class without rows, and covariance (D, D), never singular.
    """
    members = nn.functional.one_hot(labels).double()
    members /= members.sum(dim=0).clamp_min(1)
    means = members.T @ rows
    spread = (rows - means[labels]) * members.mean(dim=1).sqrt()[:, None]
    within = spread.T @ spread
    variance = within.diagonal().mean() if len(within) else torch.zeros(())
    ridge = (shrinkage * variance).clamp_min(torch.finfo(rows.dtype).eps)
    return means, within + ridge * torch.eye(len(within), dtype=rows.dtype)


def equal_scatter(rows: Tensor, labels: Tensor) -> Tensor:
    """Return the matrix (D, D) after which the scatter within classes is alike in every direction.

    The mean squared length of the rows (rows, D) stays.
    """
    _, within = scatter(rows, labels, LEVEL_SHRINKAGE)
    variances, directions = torch.linalg.eigh(within)
    whitening: Tensor = directions * variances.rsqrt()
    whitening *= rows.norm() / (rows @ whitening).norm().clamp_min(1e-300)
    return whitening


def discriminants(scores: Tensor, labels: Tensor, shrinkage: float) -> tuple[Tensor, Tensor]:
    """Return coefficients (classes, classes) and intercept (classes,) of linear discriminants.

    Args:
        scores: (rows, classes).
        labels: (rows,) class indices.
        shrinkage: As of ``scatter``.
    """
    means, within = scatter(scores, labels, shrinkage)
    absent = scores.shape[1] - len(means)  # classes beyond the last that has rows
    means = nn.functional.pad(means, (0, 0, 0, absent))
    coefficients: Tensor = torch.linalg.solve(within, means.T)
    coefficients *= len(coefficients) ** 0.5 / coefficients.norm()
    return coefficients, -(means * coefficients.T).sum(dim=1) / 2
