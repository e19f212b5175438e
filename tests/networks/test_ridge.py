"""Ridge regression and discriminants against scikit-learn and closed forms."""

import numpy as np
import pytest
import torch
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.linear_model import Ridge as SklearnRidge

from tex_lightning.networks.ridge import (
    Ridge,
    discriminants,
    equal_scatter,
    reliability_of_means,
    reliability_of_one,
    scatter,
)

CLASSES, BANDS = 3, 12
SHRINKAGE = 3.0


@pytest.mark.parametrize("bands", [BANDS, 60])  # fewer and more features than rows
def test_the_ridge_and_what_it_says_of_rows_that_it_has_not_seen_are_scikit_learns(
    bands, monkeypatch
):
    monkeypatch.setattr("tex_lightning.networks.ridge.BLOCK", 7)  # rows are taken in blocks
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(CLASSES), [8, 12, 20])  # each class weighs the same
    rows, strength = rng.standard_normal((40, bands)) + labels[:, None] / 3, 0.05
    weight = 1 / (CLASSES * np.bincount(labels)[labels])
    kept = np.ones(bands)
    kept[3:5] = 0
    problem = Ridge(
        torch.from_numpy(rows), torch.from_numpy(labels), CLASSES, torch.zeros(0, bands).double()
    )
    centred = (rows - weight @ rows) * kept
    targets = np.eye(CLASSES)[labels] - 1 / CLASSES
    ridge = strength * (weight @ (centred**2).sum(axis=1)) / len(rows)
    theirs = SklearnRidge(alpha=ridge, fit_intercept=False)
    groups = np.arange(40) % 5
    products = problem.products(torch.from_numpy(kept))
    np.testing.assert_allclose(strength * products.unit, ridge)
    for group in range(5):
        rest = torch.from_numpy(groups != group)
        weights = problem.weights(rest).numpy()
        middle, share = weights @ rows, weights @ np.eye(CLASSES)[labels]
        fitted = SklearnRidge(alpha=ridge, fit_intercept=False).fit(
            ((rows - middle) * kept)[rest], (np.eye(CLASSES)[labels] - share)[rest],
            weights[rest],
        )  # fmt: skip
        expected = ((rows - middle) * kept) @ fitted.coef_.T + share
        scores = problem.scores(products, rest, alpha=ridge, penalty=0)
        np.testing.assert_allclose(scores, expected, atol=1e-8)
    weights, offset, _ = problem.solve(products, alpha=ridge, penalty=0)
    np.testing.assert_allclose(weights.T, theirs.fit(centred, targets, weight).coef_, atol=1e-8)
    np.testing.assert_allclose(offset, 1 / CLASSES - weight @ rows @ weights.numpy(), atol=1e-8)


class Shrunk:
    """A covariance estimator as scikit-learn takes it."""

    def fit(self, rows: np.ndarray) -> None:
        covariance = np.cov(rows.T, bias=True)
        self.covariance_ = covariance + SHRINKAGE * covariance.diagonal().mean() * np.eye(CLASSES)


def test_discriminants_of_the_scores_are_scikit_learns_with_equal_priors():
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(CLASSES), [8, 12, 20])
    scores = np.eye(CLASSES)[labels] + rng.standard_normal((40, CLASSES)) @ np.diag([1, 0.5, 0.1])
    coefficients, intercept = discriminants(
        torch.from_numpy(scores), torch.from_numpy(labels), CLASSES, SHRINKAGE
    )
    theirs = LinearDiscriminantAnalysis(
        "lsqr", priors=np.full(CLASSES, 1 / CLASSES), covariance_estimator=Shrunk()
    ).fit(scores, labels)
    size = np.linalg.norm(theirs.coef_) / np.linalg.norm(coefficients)
    np.testing.assert_allclose(size * coefficients.T, theirs.coef_, atol=1e-10)
    np.testing.assert_allclose(size * intercept, theirs.intercept_ + np.log(CLASSES), atol=1e-10)


def test_levels_are_brought_to_equal_scatter_within_classes():
    rng = np.random.default_rng(0)
    labels = torch.arange(2).repeat(500)
    together = torch.from_numpy(rng.standard_normal((1000, 1)) @ np.ones((1, 3)))
    rows = 5 * together + torch.from_numpy(rng.standard_normal((1000, 3))) + labels[:, None]
    even = rows @ equal_scatter(rows, labels)
    _, within = scatter(even, labels, 0.0)
    variances = torch.linalg.eigvalsh(within)
    assert variances.max() < 1.1 * variances.min()
    torch.testing.assert_close(even.norm(), rows.norm())


@pytest.mark.parametrize("count", [40, 4])  # more and fewer rows than features
def test_scatter_within_recordings_is_a_metric_of_the_ridge(count):
    """Tikhonov's: the same as a ridge on rows that are divided by the root of the metric."""
    rng, within = np.random.default_rng(0), 0.3
    rows, labels = rng.standard_normal((count, 8)), np.arange(count) % 2
    spread = rng.standard_normal((20, 8)) * np.arange(1, 9)
    tensors = [torch.from_numpy(x) for x in (rows, labels)]
    problem = Ridge(*tensors, 2, torch.from_numpy(spread))
    products = problem.products(torch.ones(8).double())
    ridge = 0.2
    metric = within * spread.T @ spread / 20 + ridge * np.eye(8)
    root = np.linalg.inv(np.linalg.cholesky(metric)).T
    plain = Ridge(torch.from_numpy(rows @ root), tensors[1], 2, torch.zeros(0, 8).double())
    every = torch.ones(count, dtype=torch.bool)
    expected = plain.scores(plain.products(torch.ones(8)), every, alpha=1, penalty=0)
    scores = problem.scores(products, every, alpha=ridge, penalty=within)
    np.testing.assert_allclose(scores, expected, atol=1e-9)
    weights, offset, _ = problem.solve(products, alpha=ridge, penalty=within)
    np.testing.assert_allclose(tensors[0] @ weights + offset, expected, atol=1e-9)


def test_reliability_of_a_mean_is_its_squared_correlation_with_the_truth():
    rng, one = np.random.default_rng(0), 0.4
    truth = rng.standard_normal(200_000)
    errors = np.sqrt(1 / one - 1) * rng.standard_normal((5, len(truth)))
    counts = torch.tensor([1.0, 2.0, 5.0])
    found = reliability_of_means(one, counts)
    for count, share in zip((1, 2, 5), found, strict=True):
        mean = truth + errors[:count].mean(axis=0)
        assert abs(np.corrcoef(mean, truth)[0, 1] ** 2 - share) < 5e-3
    assert reliability_of_one(float(found[1] / found[2]), 2, 5) == pytest.approx(one)
