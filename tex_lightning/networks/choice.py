"""Settings of the scores of a LinearNet, chosen on training rows that are left out of the fit."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor

from tex_lightning.core.devices import with_float64
from tex_lightning.networks.ridge import (
    Products,
    Ridge,
    discriminants,
    reliability_of_means,
    reliability_of_one,
    whitened,
)
from tex_lightning.networks.rows import LeftOut, chosen_rows, count_units

SHARPNESS = 10.0  # of scores from about 0 to 1, to begin with
STRENGTHS = (0.001, 0.01, 0.1, 1.0)  # of the ridge, at first; the grid goes on at its ends
STRENGTH_LIMITS = (1e-6, 1e4)
TIE = 1.01  # errors within 1 % are equal, and the stronger ridge is taken
MIN_RELIABILITY = 0.05  # of one recording's score
MANY = 5  # recordings of a class, from which on its scores are as large as with more
MAX_THINNED = 50  # classes that reliability is measured on
MANY_ROWS = 2400  # of which a tenth tells the scale of scores better than those: it falls with them


class Choice(NamedTuple):
    """Settings that were tried on rows that were left out.

    Attributes:
        products: Products of the rows by the features in use.
        penalty: Weight of the changes that are to change no score.
        ridge: The ridge.
        scores: Scores (rows, classes) of each row when it was left out.
        errors: Squared error (rows,) of each, times its weight.
    """

    products: Products
    penalty: float
    ridge: float
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
        weight: By which the changes count.
    """

    ridge: Ridge
    left_out: LeftOut
    strength: float | None
    shrinkage: float
    weight: float

    def choose(self, subsets: Iterable[Tensor]) -> Choice:
        """Choose the settings with the smallest error on the parts that are left out.

        Then the changes are added. What is left out has none of them, and could not tell their
        weight: it grows with the units of all classes, as the ridge falls with the number of rows.
        ``subsets`` say which features (D,) may be used together, by 1 or 0 each.
        """
        tried = (self._best_strength(self.ridge.products(kept)) for kept in subsets)
        best = min(tried, key=lambda choice: choice.error)
        if not len(self.ridge.changes):
            return best
        units = count_units(self.ridge.labels, self.left_out.units, self.ridge.classes).sum()
        return self._tried(best.products, self.weight * float(units) * best.ridge, best.ridge)

    def _best_strength(self, products: Products) -> Choice:
        """Return the choice of strength with the smallest error, inside of what was tried."""
        grid = STRENGTHS if self.strength is None else (self.strength,)
        choices = {
            strength: self._tried(products, 0, strength * products.size) for strength in grid
        }
        while self.strength is None:
            best = min(choices, key=lambda strength: choices[strength].error)
            further = best * 10 if best == max(choices) else best / 10
            low, high = STRENGTH_LIMITS
            if min(choices) < best < max(choices) or not low < further < high:
                break
            choices[further] = self._tried(products, 0, further * products.size)
        least = min(choice.error for choice in choices.values())
        return choices[max(x for x, choice in choices.items() if choice.error <= TIE * least)]

    def _tried(self, products: Products, penalty: float, size: float) -> Choice:
        left_out = self._left_out(partial(self.ridge.scores, products, penalty, size))
        weights = self.ridge.weights(self.left_out.parts >= 0)
        errors = weights * (left_out - self.ridge.targets).square().sum(dim=1)
        return Choice(products, penalty, size, left_out, errors)

    def _left_out(self, scores: Callable[[Tensor], Tensor]) -> Tensor:
        """Return the scores (rows, classes) of each row by a fit without its part, else 0.

        ``scores`` gives those of all rows by a fit to those that are marked.
        """
        parts = self.left_out.parts
        left_out = torch.zeros(len(parts), self.ridge.classes).double()
        for part in {*parts[parts >= 0].tolist()}:
            out = parts == part
            left_out[out] = scores(~out)[out]
        return left_out

    def reliability(self, choice: Choice) -> tuple[float | None, Tensor]:
        """Return the reliability of one unit's score, and the units (classes,) of each class.

        What share of a score new recordings keep is measured by the parts that are left out, and
        with as few units as the smallest class has. It is None where classes need not differ.
        """
        ridge, (parts, units) = self.ridge, self.left_out
        counts = count_units(ridge.labels, units, ridge.classes).clamp_min(1)
        least = int(counts.min())
        larger = (counts > least).nonzero()[:MAX_THINNED, 0].tolist()
        if not larger or least >= MANY:
            return None, counts
        shares: list[tuple[float, float, float]] = []
        for label in larger:
            members = torch.tensor(sorted({*units[ridge.labels == label].tolist()}))
            out = (ridge.labels == label) & ~torch.isin(units, members[:least])
            fewer = ridge.scores(choice.products, choice.penalty, choice.ridge, ~out)
            thinned = _share(fewer[out], label)
            divided = len({*parts[ridge.labels == label].tolist()})
            fitted = float(counts[label]) * (1 - 1 / divided)
            shares.append((thinned, _share(choice.scores[out], label), fitted))
        thinned, whole, fitted = (sum(x) / len(larger) for x in zip(*shares, strict=True))
        one = thinned
        if fitted > least:
            one = reliability_of_one(thinned / max(whole, 1e-9), least, fitted)
        return min(max(one, MIN_RELIABILITY), 1.0), counts

    def left_out_scores(self, choice: Choice, factors: Tensor) -> Tensor:
        """Return the final scores (rows, classes) of each row by a fit without its part, else 0."""
        ridge = self.ridge

        def scores(rest: Tensor) -> Tensor:
            found = ridge.scores(choice.products, choice.penalty, choice.ridge, rest)
            coefficients, intercept = self._discriminants(found[rest], ridge.labels[rest])
            return enlarged((found @ coefficients + intercept).T, factors).T

        return self._left_out(scores)

    def solve(self, ridge: Ridge, choice: Choice) -> tuple[Tensor, Tensor, Tensor]:
        """Return whitening, weights (D, classes) and bias (classes,) of a fit to all rows."""
        weights, offset, whitening = ridge.solve(choice.products, choice.penalty, choice.ridge)
        scores = whitened(ridge.rows, whitening) @ weights + offset
        coefficients, intercept = self._discriminants(scores, ridge.labels)
        return whitening, weights @ coefficients, offset @ coefficients + intercept

    def _discriminants(self, scores: Tensor, labels: Tensor) -> tuple[Tensor, Tensor]:
        classes = scores.shape[1]
        freedom = max(1, len(scores) - classes)  # with which the scatter is known
        return discriminants(scores, labels, self.shrinkage * classes / freedom)

    def sharpness_of_one_part(
        self, ridge: Ridge, parts: Tensor, choice: Choice, factors: Tensor
    ) -> float:
        """Return the scale of scores as :func:`sharpness_of` does, by the largest part alone.

        The classes or rows of the ridge are too many for a fit without each of their ``parts``
        (rows,): by more of these scores become smaller.
        """
        out = parts == parts[parts >= 0].mode().values
        labels = ridge.labels
        rest = Ridge(ridge.rows[~out], labels[~out], ridge.classes, ridge.changes, ridge.levels)
        whitening, weights, bias = self.solve(rest, choice)
        scores = whitened(ridge.rows[out], whitening) @ weights + bias
        scores, about = enlarged(scores.T, factors).T, SHARPNESS
        for _ in range(2):  # of many classes it is beyond ten times of the first
            about = sharpness_of(scores, labels[out], parts[out], about)
        return about


class Tried(NamedTuple):
    """What a line gave for the rows that its settings were chosen on.

    Attributes:
        some: Numbers of these rows.
        labels: Class index of each.
        left_out: How they were left out.
        scores: Scores (rows, classes) of each when it was left out, else 0.
    """

    some: Tensor
    labels: Tensor
    left_out: LeftOut
    scores: Tensor

    @property
    def right(self) -> int:
        """Number of the left-out rows with the right class."""
        return int((self.scores.argmax(dim=1) == self.labels)[self.left_out.parts >= 0].sum())


class Line(NamedTuple):
    """Linear scores that were fitted.

    Attributes:
        tried: What they gave for left-out rows.
        whitening: (levels, levels) that the levels are multiplied by before.
        weights: (D, classes).
        bias: (classes,).
        size: By how much the scores of each class are enlarged (classes,).
    """

    tried: Tried
    whitening: Tensor
    weights: Tensor
    bias: Tensor
    size: Tensor

    def enlarged(self, share: Tensor) -> tuple[Tensor, Tensor]:
        """Return weights (classes, D), of features times ``share`` (D,), and bias, enlarged."""
        return enlarged(share * self.weights.T, self.size), enlarged(self.bias, self.size)


def fit_line(
    rows: Tensor,
    labels: Tensor,
    left_out: LeftOut,
    changes: Tensor,
    subsets: Iterable[Tensor],
    *,
    classes: int,
    levels: int,
    strength: float | None,
    shrinkage: float,
    weight: float,
) -> Line:
    """Fit linear scores to all rows, with settings that are chosen on some of them.

    Args:
        rows: (rows, D) float64, standardised.
        labels: (rows,) class indices.
        left_out: How rows are left out.
        changes: (changes, D) that are to change no score.
        subsets: Which features (D,) may be used together.
        classes: Number of classes.
        levels: Number of the last features, whose scatter is made equal.
        strength: As of :class:`LineFit`.
        shrinkage: Likewise.
        weight: Likewise.
    """
    some, nth = chosen_rows(labels, classes)
    few, tried = labels[some] // nth, LeftOut(*(x[some] for x in left_out))
    ridge = Ridge(rows[some], few, math.ceil(classes / nth), changes, levels)
    fit = LineFit(ridge, tried, strength, shrinkage, weight)
    choice = fit.choose(subsets)
    one, counts = fit.reliability(choice)
    factors = factors_of(one, counts)
    scores = fit.left_out_scores(choice, factors)
    whole = Ridge(rows, labels, classes, changes, levels)
    if nth == 1 and len(labels) < MANY_ROWS:
        sharpness = sharpness_of(scores, few, tried.parts, SHARPNESS)
    else:
        factors = factors_of(one, count_units(labels, left_out.units, classes))
        sharpness = fit.sharpness_of_one_part(whole, left_out.parts, choice, factors)
    return Line(Tried(some, few, tried, scores), *fit.solve(whole, choice), factors * sharpness)


def factors_of(one: float | None, counts: Tensor) -> Tensor:
    """Return by how much the scores of each class are enlarged (classes,), at least 1.

    Args:
        one: Reliability of the score that one unit gives; None enlarges none.
        counts: Units (classes,) of each class.
    """
    if one is None:
        return torch.ones(len(counts)).double()
    kept = reliability_of_means(one, counts.clamp(max=MANY))
    return kept.max() / kept


def enlarged(scores: Tensor, factors: Tensor) -> Tensor:
    """Return scores (classes, ...) around their mean times the factors of the classes."""
    return (scores - scores.mean(dim=0)) * factors.reshape(-1, *[1] * (scores.dim() - 1))


def sharpness_of(left_out: Tensor, labels: Tensor, parts: Tensor, about: float) -> float:
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


def fit_temperature(logits: Sequence[Tensor], labels: Sequence[int]) -> float:
    """Return the temperature, 0.1 to 10, under which fragments' mean probabilities fit labels best.

    It minimises the cross entropy against labels that are softened as Platt (1999) does: with n
    samples the true class has (n + 1) / (n + 2), and the others share the rest. A network
    that errs on none of a few samples would otherwise be made infinitely sure.

    Args:
        logits: (classes, fragments) of each sample.
        labels: True class of each.
    """
    logits = [with_float64(scores) for scores in logits]
    classes, count = len(logits[0]), len(labels)
    rest = 1 / (count + 2)
    target = torch.full((count, classes), rest / (classes - 1), dtype=torch.float64)
    target[torch.arange(count), torch.tensor(labels)] = 1 - rest
    target = target.to(logits[0].device)

    def loss(log_temperature: float) -> float:
        scaled = [(scores.double() / 10**log_temperature).softmax(dim=0) for scores in logits]
        means = [shares.sum(dim=1) / shares.shape[1] for shares in scaled]
        return float(-(target * torch.stack(means).clamp_min(1e-300).log()).sum() / count)

    return float(10 ** scipy.optimize.minimize_scalar(loss, bounds=(-1, 1), method="bounded").x)
