"""LinearNet: class scores that are linear in the features of a fragment, fitted in closed form.

A rule with one weight for each feature needs few recordings of a class, and fitting it takes a
moment: ridge regression of the classes on the features, as in MiniRocket (Dempster et al. 2021).
"""

import math
from collections.abc import Iterator, Sequence
from itertools import product

import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor, nn

from tex_lightning.core.groups import PARTS, leave_out
from tex_lightning.networks.blocks import Head, Level

MIN_DEVIATION = 1e-3  # of a feature; one that hardly varies says nothing
SHARPNESS = 10.0  # of scores from about 0 to 1, to begin with
STRENGTHS = (0.001, 0.01, 0.1, 1.0)  # of the ridge
LEVEL_SHRINKAGE = 0.001  # of the scatter of levels within classes, in their mean variance
OPTIONAL = ("power", "axes")  # kinds of blocks that are left out unless they help
WHITENED = "level"  # kind of block whose features vary together, as under another pressure
MAX_ROWS = 2000  # that strength and blocks are chosen on


class LinearNet(nn.Module):
    """Classify every fragment by a ridge regression on its features.

    Every recording is one row, the mean of its fragments, and every class counts alike, however
    many recordings it has: what varies between the fragments of one recording is not what varies
    between recordings. Where a class has but one recording, its fragments are the rows. The score
    of a mean is the mean of the scores, so averaging the fragments' scores is the same as
    classifying the whole recording.

    What varies between recordings of one class is noise. Features of the kind ``level`` are
    brought to equal scatter within the classes before the ridge, and its scores become linear
    discriminants (Fisher 1936; Hastie et al. 1994, Flexible discriminant analysis): distances to
    the classes' mean scores in units of the scatter within classes, which is shrunk towards equal
    scatter.

    The strength of the ridge, and whether blocks of the kinds ``power`` and ``axes`` are used, are
    chosen on the training recordings: by the squared error on groups of them that are left out of
    the fit.

    Args:
        classes: Number of materials.
        bands: Features of a fragment, D.
        blocks: Kind and number of the features that belong together, in their order; each block
            counts alike, however many features it has. None takes all as one.
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

    def __init__(
        self,
        classes: int,
        *,
        bands: int,
        blocks: Sequence[tuple[str, int]] | None = None,
        strength: float | None = None,
        shrinkage: float = 30.0,
    ) -> None:
        super().__init__()
        self.classes, self.strength, self.shrinkage = classes, strength, shrinkage
        self.blocks = [("", bands)] if blocks is None else [(kind, size) for kind, size in blocks]
        self.register_buffer("mean", torch.zeros(bands, 1, 1))
        self.register_buffer("scale", torch.ones(bands, 1, 1))
        self.head = Head(nn.Sequential(), bands, classes, dropout=0)

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
        standardised = (x.transpose(1, 2) - self.mean) * self.scale
        scores: Tensor = self.head(standardised, level)
        return scores.squeeze(2)

    @property
    def score_layer(self) -> nn.Conv2d:
        """FC3, the only layer."""
        return self.head.score_layer

    @torch.no_grad()
    def fit(
        self, inputs: Sequence[Tensor], labels: Tensor, groups: Sequence[str] | None = None
    ) -> None:
        """Fit the scores to all training recordings at once.

        The scores are brought to the size at which the softmax of a recording's mean score is a
        probability: measured on each group of recordings by what the others say of it, or on each
        fragment where a class has but one group, which overestimates.

        Args:
            inputs: Features (1, D, L) of each recording.
            labels: (recordings,) class indices, each at least once.
            groups: What was recorded together, of each recording; None takes each by itself.
        """
        rows, labels, left_out = _rows(inputs, labels.cpu(), groups)
        mean, deviation = rows.mean(dim=0), rows.std(dim=0, correction=0)
        scale = torch.where(deviation > MIN_DEVIATION, 1 / deviation, 0)
        share = torch.repeat_interleave(self.sizes.double().rsqrt(), self.sizes)  # of unit length
        rows = (rows - mean) * scale * share
        levels = torch.repeat_interleave(self._are(WHITENED), self.sizes)
        whitening = equal_scatter(rows[:, levels], labels)
        rows[:, levels] = rows[:, levels] @ whitening
        some = slice(None, None, math.ceil(len(rows) / MAX_ROWS))
        kept, strength, held_out = self._choose(rows[some], labels[some], left_out[some])
        problem = _Ridge(rows, labels, self.classes)
        weight = problem.solve(kept, strength)
        offset = problem.share - problem.centre @ weight
        freedom = max(1, len(rows) - self.classes)  # with which the scatter is known
        shrinkage = self.shrinkage * self.classes / freedom
        coefficients, intercept = discriminants(rows @ weight + offset, labels, shrinkage)
        scores = list(SHARPNESS * (held_out @ coefficients + intercept)[:, :, None])
        sharpness = SHARPNESS / fit_temperature(scores, labels[some].tolist())
        weight[levels] = whitening @ weight[levels]
        self.mean.copy_(mean[:, None, None])
        self.scale.copy_(scale[:, None, None])
        layer = self.score_layer
        layer.weight.copy_(sharpness * (share[:, None] * weight @ coefficients).T[:, :, None, None])
        layer.bias = nn.Parameter(
            (sharpness * (offset @ coefficients + intercept)).to(layer.weight)
        )

    @property
    def sizes(self) -> Tensor:
        """Number of features of each block."""
        return torch.tensor([size for _, size in self.blocks])

    def _are(self, kind: str) -> Tensor:
        """Return which blocks are of a kind."""
        return torch.tensor([block == kind for block, _ in self.blocks])

    def _choose(
        self, rows: Tensor, labels: Tensor, left_out: Tensor
    ) -> tuple[Tensor, float, Tensor]:
        """Choose features and strength by the squared error on parts that are left out.

        Args:
            rows: (rows, D) standardised.
            labels: (rows,) class indices.
            left_out: (rows,) part in which each row is left out.

        Returns:
            Which features are used (D,), the strength, and the scores (rows, classes) of each row
            when it was left out.
        """
        problem = _Ridge(rows, labels, self.classes)
        targets = nn.functional.one_hot(labels, self.classes)
        least, choice = math.inf, (torch.ones(0), 0.0, torch.ones(0))
        for kept in self._subsets():
            gram = problem.gram(kept)
            for strength in STRENGTHS if self.strength is None else (self.strength,):
                scores = problem.held_out(gram, strength, left_out)
                error = float(problem.weight @ (scores - targets).square().sum(dim=1))
                if error < least:
                    least, choice = error, (kept, strength, scores)
        return choice

    def _subsets(self) -> Iterator[Tensor]:
        """Yield which features (D,) are used: with every choice of optional blocks, none first."""
        kinds = [kind for kind in OPTIONAL if self._are(kind).any()]
        for wanted in product((False, True), repeat=len(kinds)):
            left_out = {kind for kind, use in zip(kinds, wanted, strict=True) if not use}
            kept = torch.tensor([kind not in left_out for kind, _ in self.blocks])
            if kept.any():
                yield torch.repeat_interleave(kept, self.sizes).double()


def _rows(
    inputs: Sequence[Tensor], labels: Tensor, groups: Sequence[str] | None
) -> tuple[Tensor, Tensor, Tensor]:
    """Return a row for each recording, or for each fragment where a class has but one group.

    Returns:
        Rows (rows, D), their labels, and the part in which each is left out.
    """
    left_out = leave_out(labels.tolist(), groups or range(len(labels)))
    if left_out:
        rows = torch.stack([features[0].double().mean(dim=1).cpu() for features in inputs])
        return rows, labels, torch.tensor(left_out)
    counts = torch.tensor([features.shape[-1] for features in inputs])
    rows = torch.cat([features[0].T for features in inputs]).cpu().double()
    return rows, torch.repeat_interleave(labels, counts), torch.arange(len(rows)) % PARTS


class _Ridge:
    """Ridge regression of the classes on rows, in which every class weighs the same.

    Args:
        rows: (rows, D) float64.
        labels: (rows,) class indices.
        classes: Number of classes.

    Attributes:
        weight: (rows,) weights, of sum 1.
        centre: (D,) weighted mean of the rows.
        share: (classes,) weighted mean of the targets.
    """

    def __init__(self, rows: Tensor, labels: Tensor, classes: int) -> None:
        counts = torch.bincount(labels, minlength=classes)
        self.weight = 1 / ((counts > 0).sum() * counts[labels]).double()
        self.root = self.weight.sqrt()[:, None]
        targets = nn.functional.one_hot(labels, classes).double()
        self.centre, self.share = self.weight @ rows, self.weight @ targets
        self.rows = (rows - self.centre) * self.root
        self.targets = (targets - self.share) * self.root

    def gram(self, kept: Tensor) -> Tensor:
        """Return products (rows, rows) of the rows by the features in use (D,)."""
        rows = self.rows * kept
        return rows @ rows.T

    def held_out(self, gram: Tensor, strength: float, left_out: Tensor) -> Tensor:
        """Return the scores (rows, classes) of each row by a fit without its part."""
        inverse = torch.linalg.inv(gram + _ridge(gram, strength))
        dual = inverse @ self.targets
        scores = torch.empty_like(self.targets)
        for part in set(left_out.tolist()):
            out = left_out == part
            scores[out] = self.targets[out] - torch.linalg.solve(inverse[out][:, out], dual[out])
        return scores / self.root + self.share

    def solve(self, kept: Tensor, strength: float) -> Tensor:
        """Return the weights (D, classes) of standardised features."""
        rows = self.rows * kept
        if len(rows) <= rows.shape[1]:
            gram = rows @ rows.T
            dual: Tensor = torch.linalg.solve(gram + _ridge(gram, strength), self.targets)
            return rows.T @ dual
        covariance = rows.T @ rows
        ridge = strength * covariance.trace() / len(rows)
        identity = torch.eye(len(covariance), dtype=covariance.dtype)
        weights: Tensor = torch.linalg.solve(covariance + ridge * identity, rows.T @ self.targets)
        return weights


def scatter(rows: Tensor, labels: Tensor, shrinkage: float) -> tuple[Tensor, Tensor]:
    """Return the means of the classes and the scatter within them, in which all weigh the same.

    Args:
        rows: (rows, D) float64.
        labels: (rows,) class indices, each at least once.
        shrinkage: What is added to every variance, as a multiple of their mean.

    Returns:
        Means (classes, D) and covariance (D, D), never singular.
    """
    members = nn.functional.one_hot(labels).double()
    members /= members.sum(dim=0)
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
        labels: (rows,) class indices, each at least once.
        shrinkage: As of ``scatter``.
    """
    means, within = scatter(scores, labels, shrinkage)
    coefficients: Tensor = torch.linalg.solve(within, means.T)
    coefficients *= len(coefficients) ** 0.5 / coefficients.norm()
    return coefficients, -(means * coefficients.T).sum(dim=1) / 2


def _ridge(gram: Tensor, strength: float) -> Tensor:
    """Return the ridge: a multiple of the identity, relative to the mean squared row."""
    ridge = (strength * gram.trace() / len(gram)).clamp_min(torch.finfo(gram.dtype).tiny)
    return ridge * torch.eye(len(gram), dtype=gram.dtype)


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
        means = [each.sum(dim=1) / each.shape[1] for each in scaled]
        return float(-(target * torch.stack(means).clamp_min(1e-300).log()).sum() / count)

    return float(10 ** scipy.optimize.minimize_scalar(loss, bounds=(-1, 1), method="bounded").x)
