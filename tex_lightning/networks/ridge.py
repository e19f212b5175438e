"""Ridge regression of the classes on features, fitted to subsets of the rows, and discriminants.

A fit to rows x_i of the classes y_i, which are one-hot, has the weights W and the offset b of the
least

    sum_i v_i |x_i W + b - y_i|² + alpha |W|² + penalty * mean_j |c_j W|²

Every class has the same share of the v_i, however many rows it has, and they add up to 1. The c_j
are changes of a row that are to change no score.

Rows are few and features many, so that scores are computed from products of rows, once for all
subsets (:class:`Products`). Along the few directions of the changes these products are reduced, as
by the identity of Woodbury. Only levels are multiplied anew for each subset: they are brought to
equal scatter within the classes, of which rows that are left out must not tell.
"""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor, nn

LEVEL_SHRINKAGE = 0.001  # of the scatter of levels within classes, in their mean variance
BLOCK = 1000  # rows that are multiplied at once
MIN_VARIANCE = 1e-9  # of a direction of changes, as a share of the largest


class Products(NamedTuple):
    """Products of rows by the features in use.

    Attributes:
        used: Which features are used (D,), 1 or 0.
        gram: Products (rows, rows) by all features but the levels.
        along: Rows along the directions in which changes lie, (rows, R).
        directions: These directions (R, D), orthonormal.
        variances: Mean square of the changes along each of them (R,).
        unit: Weighted mean squared length of the centred rows, divided by their number: the alpha
            of a strength of 1.
    """

    used: Tensor
    gram: Tensor
    along: Tensor
    directions: Tensor
    variances: Tensor
    unit: float


class Ridge:
    """Ridge regressions of the classes on subsets of rows.

    Args:
        rows: (rows, D) float64.
        labels: (rows,) class indices.
        classes: Number of classes.
        changes: Changes (changes, D) of rows that are to change no score.
        level_features: Number of the last features, which are levels.
    """

    def __init__(
        self, rows: Tensor, labels: Tensor, classes: int, changes: Tensor, level_features: int = 0
    ) -> None:
        self.rows, self.labels, self.classes = rows, labels, classes
        self.changes, self.level_features = changes, level_features
        self.targets = nn.functional.one_hot(labels, classes).double()

    def weights(self, fitted: Tensor) -> Tensor:
        """Return weights (rows,) of sum 1, 0 for rows that are not ``fitted`` to (rows,).

        With all rows every class counts alike. A row counts no more for those of its class that are
        left out: of two recordings the other one would else be trusted like both.
        """
        counts = torch.bincount(self.labels, minlength=self.classes)
        weights = fitted / counts[self.labels].double()
        return weights / weights.sum()

    def products(self, used: Tensor) -> Products:
        """Return the products of rows by the features in use, (D,) of 1 or 0."""
        rows, changes = self.rows * used, self.changes * used
        values, vectors = torch.linalg.eigh(changes @ changes.T)
        large = values > MIN_VARIANCE * values.max() if len(values) else values > 0
        directions = (vectors[:, large] / values[large].sqrt()).T @ changes
        weights = self.weights(torch.ones_like(self.labels, dtype=torch.bool))
        square = weights @ rows.square().sum(dim=1) - (weights @ rows).square().sum()
        others = rows[:, : rows.shape[1] - self.level_features]
        along, variances = rows @ directions.T, values[large] / max(1, len(changes))
        unit = float(square) / len(rows)
        return Products(used, others @ others.T, along, directions, variances, unit)

    def scores(self, products: Products, fitted: Tensor, *, alpha: float, penalty: float) -> Tensor:
        """Return the scores (rows, classes) of all rows by a fit to some of them.

        Args:
            products: Of the features in use.
            fitted: (rows,) whether each row is fitted to.
            alpha: Weight of the squared weights.
            penalty: Weight of the squared changes.
        """
        kernel = products.gram  # of rows, then as after what the fit does to their features
        if penalty:
            shrunk = _shrunk(penalty * products.variances, alpha)
            kernel = kernel - products.along * shrunk @ products.along.T
        if self.level_features:
            levels = self.rows[:, -self.level_features :]
            levels = levels @ equal_scatter(levels[fitted], self.labels[fitted])
            kernel = kernel + levels @ levels.T
        weights = self.weights(fitted)
        mean = kernel @ weights
        centred = kernel - mean - mean[:, None] + weights @ mean
        root, share = weights[fitted].sqrt()[:, None], weights @ self.targets
        inner = root * centred[fitted][:, fitted] * root.T + alpha * torch.eye(len(root)).double()
        dual = root * torch.linalg.solve(inner, root * (self.targets[fitted] - share))
        scores: Tensor = centred[:, fitted] @ dual + share
        return scores

    def solve(
        self, products: Products, *, alpha: float, penalty: float
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Fit to all rows; arguments are those of :meth:`scores`.

        Returns:
            Weights (D, classes) of the features, whose levels have to be brought to equal scatter
            by the matrix (levels, levels), which is the third, and offset (classes,).
        """
        every = torch.ones_like(self.labels, dtype=torch.bool)
        weights, whitening = self.weights(every), torch.eye(self.level_features).double()
        if self.level_features:
            whitening = equal_scatter(self.rows[:, -self.level_features :], self.labels)
        mean, share = weights @ self.rows, weights @ self.targets
        mean = whitened(mean[None] * products.used, whitening)
        root = weights.sqrt()[:, None]
        targets, variances = root * (self.targets - share), penalty * products.variances

        def centred(some: slice) -> Tensor:
            rows = whitened(self.rows[some] * products.used, whitening)
            return rows.sub_(mean).mul_(root[some])

        if len(self.rows) > self.rows.shape[1]:
            solution = _solved_by_features(centred, targets, products.directions, variances, alpha)
        else:
            rows = centred(slice(None))
            solution = _solved_by_rows(rows, targets, products.directions, variances, alpha)
        return solution, share - (mean @ solution)[0], whitening


def _shrunk(variances: Tensor, alpha: float) -> Tensor:
    """Return by how much products of rows are reduced along each direction (R,)."""
    return variances / (alpha + variances)


def _solved_by_features(
    rows: Callable[[slice], Tensor],
    targets: Tensor,
    directions: Tensor,
    variances: Tensor,
    alpha: float,
) -> Tensor:
    """Return weights (D, classes) from products (D, D) of features that are fewer than the rows.

    Args:
        rows: Gives some of the rows (some, D), times the roots of their weights.
        targets: (rows, classes), likewise.
        directions: (R, D), in which changes lie.
        variances: (R,) of the changes, times the penalty.
        alpha: As of :meth:`Ridge.scores`.
    """
    metric = (directions.T * variances) @ directions
    metric += alpha * torch.eye(len(metric)).double()
    moments = metric.new_zeros(len(metric), targets.shape[1])
    for first in range(0, len(targets), BLOCK):
        some = slice(first, first + BLOCK)
        block = rows(some)
        metric.addmm_(block.T, block)
        moments.addmm_(block.T, targets[some])
    solution: Tensor = torch.linalg.solve(metric, moments)
    return solution


def _solved_by_rows(
    rows: Tensor, targets: Tensor, directions: Tensor, variances: Tensor, alpha: float
) -> Tensor:
    """Return the same from products (rows, rows) of rows; arguments are as before."""
    shrunk, along = _shrunk(variances, alpha), rows @ directions.T
    inner = rows @ rows.T - along * shrunk @ along.T + alpha * torch.eye(len(rows)).double()
    plain: Tensor = rows.T @ torch.linalg.solve(inner, targets)
    return plain - directions.T @ (shrunk[:, None] * (directions @ plain))


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


def discriminants(
    rows: Tensor, labels: Tensor, classes: int, shrinkage: float
) -> tuple[Tensor, Tensor]:
    """Return coefficients (D, classes) and intercept (classes,) of linear discriminants.

    Args:
        rows: (rows, D) float64.
        labels: (rows,) class indices.
        classes: Number of classes.
        shrinkage: As of ``scatter``.
    """
    means, within = scatter(rows, labels, shrinkage)
    absent = classes - len(means)  # classes beyond the last that has rows
    means = nn.functional.pad(means, (0, 0, 0, absent))
    coefficients: Tensor = torch.linalg.solve(within, means.T)
    coefficients *= len(coefficients) ** 0.5 / coefficients.norm()
    return coefficients, -(means * coefficients.T).sum(dim=1) / 2
