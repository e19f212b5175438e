"""Fit the line of a LinearNet: its settings are chosen on training rows that are left out of fits.

:func:`fit_line` goes through it. The settings with the least error are chosen among
:class:`Candidate`; discriminants make the scores of the ridge sharper; the scores of a class with
few recordings are enlarged, by their reliability; and all are scaled to be as sure as they are
right.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor

from tex_lightning.networks.ridge import (
    Products,
    Ridge,
    discriminants,
    reliability_of_means,
    reliability_of_one,
    whitened,
)
from tex_lightning.networks.rows import LeftOut, chosen_rows, count_units
from tex_lightning.networks.temperature import sharpness_of

SHARPNESS = 10.0  # of scores from about 0 to 1, to begin with
STRENGTHS = (0.001, 0.01, 0.1, 1.0)  # of the ridge, at first; the grid goes on at its ends
STRENGTH_LIMITS = (1e-6, 1e4)
TIE = 1.01  # errors within 1 % are equal, and the stronger ridge is taken
MIN_RELIABILITY = 0.05  # of one recording's score
MANY = 5  # recordings of a class, from which on its scores are as large as with more
MAX_THINNED = 50  # classes that reliability is measured on
MANY_ROWS = 2400  # of which a tenth tells the scale of scores better than those: it falls with them


class Candidate(NamedTuple):
    """Settings that were tried on rows that were left out.

    Attributes:
        products: Products of the rows by the features in use.
        alpha: Weight of the squared weights.
        penalty: Weight of the changes that are to change no score.
        scores: Scores (rows, classes) of each row when it was left out.
        errors: Squared error (rows,) of each, times its weight.
    """

    products: Products
    alpha: float
    penalty: float
    scores: Tensor
    errors: Tensor

    @property
    def error(self) -> float:
        """The weighted mean squared error."""
        return float(self.errors.sum())


@dataclass(frozen=True)
class LineFit:
    """Linear discriminants of the scores of a ridge regression, and how its settings are chosen.

    Attributes:
        ridge: Of the rows that settings are chosen on.
        left_out: How these are left out.
        strength: As of a LinearNet.
        shrinkage: Likewise.
        changes_weight: By which the changes count.
    """

    ridge: Ridge
    left_out: LeftOut
    strength: float | None
    shrinkage: float
    changes_weight: float

    def choose(self, subsets: Iterable[Tensor]) -> Candidate:
        """Choose the settings with the smallest error on the parts that are left out.

        Then the changes are added. What is left out has none of them, and could not tell their
        weight: it grows with the units of all classes, as alpha falls with the number of rows.
        ``subsets`` say which features (D,) may be used together, by 1 or 0 each.
        """
        candidates = (self._best_strength(self.ridge.products(used)) for used in subsets)
        best = min(candidates, key=lambda candidate: candidate.error)
        if not len(self.ridge.changes):
            return best
        units = count_units(self.ridge.labels, self.left_out.units, self.ridge.classes).sum()
        penalty = self.changes_weight * float(units) * best.alpha
        return self._tried(best.products, best.alpha, penalty)

    def _best_strength(self, products: Products) -> Candidate:
        """Return the candidate with the strength of the smallest error, inside of what was tried.

        Of strengths that are as good the largest is taken.
        """
        grid = STRENGTHS if self.strength is None else (self.strength,)
        tried = {strength: self._tried(products, strength * products.unit) for strength in grid}
        while self.strength is None:
            best = min(tried, key=lambda strength: tried[strength].error)
            further = best * 10 if best == max(tried) else best / 10
            low, high = STRENGTH_LIMITS
            if min(tried) < best < max(tried) or not low < further < high:
                break
            tried[further] = self._tried(products, further * products.unit)
        least = min(candidate.error for candidate in tried.values())
        return tried[max(x for x, candidate in tried.items() if candidate.error <= TIE * least)]

    def _tried(self, products: Products, alpha: float, penalty: float = 0) -> Candidate:
        fit = partial(self.ridge.scores, products, alpha=alpha, penalty=penalty)
        scores = self._left_out(fit)
        weights = self.ridge.weights(self.left_out.parts >= 0)
        errors = weights * (scores - self.ridge.targets).square().sum(dim=1)
        return Candidate(products, alpha, penalty, scores, errors)

    def _left_out(self, fit: Callable[[Tensor], Tensor]) -> Tensor:
        """Return the scores (rows, classes) of each row by a fit without its part, else 0.

        ``fit`` gives those of all rows by a fit to those that are marked.
        """
        parts = self.left_out.parts
        scores = torch.zeros(len(parts), self.ridge.classes).double()
        for part in {*parts[parts >= 0].tolist()}:
            out = parts == part
            scores[out] = fit(~out)[out]
        return scores

    def reliability(self, chosen: Candidate) -> tuple[float | None, Tensor]:
        """Return the reliability of one unit's score, and the units (classes,) of each class.

        New rows keep a part of the score that their class has in the targets, and the less, the
        fewer units it was fitted to. What they keep is measured twice for each class with more
        units than the smallest one: with as many as that has, and with all but the part that is
        left out. By the formula of Spearman and Brown the ratio tells the reliability of one. It is
        None where classes need not differ.
        """
        ridge, (_, units) = self.ridge, self.left_out
        counts = count_units(ridge.labels, units, ridge.classes).clamp_min(1)
        least = int(counts.min())
        larger = (counts > least).nonzero()[:MAX_THINNED, 0].tolist()
        if not larger or least >= MANY:
            return None, counts
        measured = [self._kept_shares(chosen, label, least) for label in larger]
        by_few, by_most, most = (sum(x) / len(larger) for x in zip(*measured, strict=True))
        one = by_few
        if most > least:
            one = reliability_of_one(by_few / max(by_most, 1e-9), least, most)
        return min(max(one, MIN_RELIABILITY), 1.0), counts

    def _kept_shares(self, chosen: Candidate, label: int, few: int) -> tuple[float, float, float]:
        """Return what left-out rows of a class keep of its score.

        Returns:
            By a fit to only ``few`` units of the class, by fits to all but a part of it, and the
            mean number of units in these.
        """
        ridge, (parts, units) = self.ridge, self.left_out
        is_class = ridge.labels == label
        members = torch.tensor(sorted({*units[is_class].tolist()}))
        out = is_class & ~torch.isin(units, members[:few])
        scores = ridge.scores(chosen.products, ~out, alpha=chosen.alpha, penalty=chosen.penalty)
        divided = len({*parts[is_class].tolist()})
        most = float(len(members)) * (1 - 1 / divided)
        return _share(scores[out], label), _share(chosen.scores[out], label), most

    def left_out_scores(self, chosen: Candidate, factors: Tensor) -> Tensor:
        """Return the final scores (rows, classes) of each row by a fit without its part, else 0."""
        ridge = self.ridge

        def fit(rest: Tensor) -> Tensor:
            scores = ridge.scores(chosen.products, rest, alpha=chosen.alpha, penalty=chosen.penalty)
            coefficients, intercept = self._discriminants(scores[rest], ridge.labels[rest])
            return enlarged((scores @ coefficients + intercept).T, factors).T

        return self._left_out(fit)

    def solve(self, ridge: Ridge, chosen: Candidate) -> tuple[Tensor, Tensor, Tensor]:
        """Return whitening, weights (D, classes) and bias (classes,) of a fit to all rows."""
        weights, offset, whitening = ridge.solve(
            chosen.products, alpha=chosen.alpha, penalty=chosen.penalty
        )
        scores = whitened(ridge.rows, whitening) @ weights + offset
        coefficients, intercept = self._discriminants(scores, ridge.labels)
        return whitening, weights @ coefficients, offset @ coefficients + intercept

    def _discriminants(self, scores: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
        classes = scores.shape[1]
        freedom = max(1, len(scores) - classes)  # with which the scatter is known
        return discriminants(scores, labels, classes, self.shrinkage * classes / freedom)

    def sharpness_of_one_part(
        self, ridge: Ridge, parts: Tensor, chosen: Candidate, factors: Tensor
    ) -> float:
        """Return the scale of scores as :func:`sharpness_of` does, by the largest part alone.

        The classes or rows of the ridge are too many for a fit without each of their ``parts``
        (rows,): by more of these scores become smaller.
        """
        out = parts == parts[parts >= 0].mode().values
        labels, levels = ridge.labels, ridge.level_features
        rest = Ridge(ridge.rows[~out], labels[~out], ridge.classes, ridge.changes, levels)
        whitening, weights, bias = self.solve(rest, chosen)
        scores = whitened(ridge.rows[out], whitening) @ weights + bias
        scores, about = enlarged(scores.T, factors).T, SHARPNESS
        for _ in range(2):  # of many classes it is beyond ten times of the first
            about = sharpness_of(scores, labels[out], parts[out], about)
        return about


class LeftOutScores(NamedTuple):
    """What a line gave for the rows that its settings were chosen on, when they were left out.

    Attributes:
        numbers: Numbers of these rows.
        labels: Class index of each.
        parts: Part in which each was left out; -1 for none.
        units: Number of what it was left out with.
        scores: Scores (rows, classes) of each when it was left out, else 0.
    """

    numbers: Tensor
    labels: Tensor
    parts: Tensor
    units: Tensor
    scores: Tensor

    @property
    def correct(self) -> int:
        """Number of the left-out rows with the right class."""
        return int((self.scores.argmax(dim=1) == self.labels)[self.parts >= 0].sum())


class Line(NamedTuple):
    """Linear scores that were fitted.

    Attributes:
        left_out: What they gave for left-out rows.
        whitening: (levels, levels) that the levels are multiplied by before.
        weights: (D, classes).
        bias: (classes,).
        factors: By how much the scores of each class are enlarged (classes,).
    """

    left_out: LeftOutScores
    whitening: Tensor
    weights: Tensor
    bias: Tensor
    factors: Tensor

    def layer(self, scale: Tensor) -> tuple[Tensor, Tensor]:
        """Return weights (classes, D) of features before they are scaled (D,), and bias."""
        return enlarged(scale * self.weights.T, self.factors), enlarged(self.bias, self.factors)


def fit_line(
    rows: Tensor,
    labels: Tensor,
    left_out: LeftOut,
    changes: Tensor,
    subsets: Iterable[Tensor],
    *,
    classes: int,
    level_features: int,
    strength: float | None,
    shrinkage: float,
    changes_weight: float,
) -> Line:
    """Fit linear scores to all rows, with settings that are chosen on some of them.

    Args:
        rows: (rows, D) float64, standardised.
        labels: (rows,) class indices.
        left_out: How rows are left out.
        changes: (changes, D) that are to change no score.
        subsets: Which features (D,) may be used together.
        classes: Number of classes.
        level_features: Number of the last features, whose scatter is made equal.
        strength: As of :class:`LineFit`.
        shrinkage: Likewise.
        changes_weight: Likewise.
    """
    some, nth = chosen_rows(labels, classes)
    few, parts, units = labels[some] // nth, left_out.parts[some], left_out.units[some]
    ridge = Ridge(rows[some], few, math.ceil(classes / nth), changes, level_features)
    fit = LineFit(ridge, LeftOut(parts, units), strength, shrinkage, changes_weight)
    chosen = fit.choose(subsets)
    reliability, counts = fit.reliability(chosen)
    factors = class_factors(reliability, counts)
    scores = fit.left_out_scores(chosen, factors)
    whole = Ridge(rows, labels, classes, changes, level_features)
    if nth == 1 and len(labels) < MANY_ROWS:
        sharpness = sharpness_of(scores, few, parts, SHARPNESS)
    else:
        factors = class_factors(reliability, count_units(labels, left_out.units, classes))
        sharpness = fit.sharpness_of_one_part(whole, left_out.parts, chosen, factors)
    tried = LeftOutScores(some, few, parts, units, scores)
    return Line(tried, *fit.solve(whole, chosen), factors * sharpness)


def class_factors(reliability: float | None, counts: Tensor) -> Tensor:
    """Return by how much the scores of each class are enlarged (classes,), at least 1.

    Args:
        reliability: Of the score that one unit gives; None enlarges none.
        counts: Units (classes,) of each class.
    """
    if reliability is None:
        return torch.ones(len(counts)).double()
    kept = reliability_of_means(reliability, counts.clamp(max=MANY))
    return kept.max() / kept


def enlarged(scores: Tensor, factors: Tensor) -> Tensor:
    """Return scores (classes, ...) around their mean times the factors of the classes."""
    return (scores - scores.mean(dim=0)) * factors.reshape(-1, *[1] * (scores.dim() - 1))


def _share(scores: Tensor, label: int) -> float:
    """Return the mean score of a class in (rows, classes), as a share of that of the targets."""
    return float((scores[:, label] - scores.mean(dim=1)).mean() / (1 - 1 / scores.shape[1]))
