"""LinearNet: class scores that are linear in the features of a fragment, fitted in closed form.

A rule with one weight for each feature needs few recordings of a class, and fitting it takes a
moment: ridge regression of the classes on the features, as in MiniRocket (Dempster et al. 2021).
"""

from collections.abc import Sequence

import torch
from scipy.optimize import minimize_scalar
from torch import Tensor, nn

from tex_lightning.core.groups import PARTS, leave_out
from tex_lightning.networks.blocks import Head, Level

LEAST_DEVIATION = 1e-3  # of a feature; one that hardly varies says nothing
SHARPNESS = 10.0  # of scores from about 0 to 1, to begin with


class LinearNet(nn.Module):
    """Classify every fragment by a ridge regression on its features.

    The score of a mean is the mean of the scores: averaging the fragments' scores is as good as
    looking at the whole recording at once.

    Args:
        classes: Number of materials.
        bands: Features of a fragment, D.
        strength: Strength of the ridge, as a share of the mean squared length of a fragment's
            standardised features.

    Example:
        >>> import torch
        >>> from tex_lightning.networks.linear import LinearNet
        >>> network = LinearNet(classes=2, bands=3, strength=0.03)
        >>> one, other = torch.rand(1, 3, 20), 1 + torch.rand(1, 3, 20)
        >>> network.fit([one, other, one, other], torch.tensor([0, 1, 0, 1]))
        >>> network(other[None]).argmax(dim=1).unique()
        tensor([1])
    """

    mean: Tensor
    scale: Tensor

    def __init__(self, classes: int, *, bands: int, strength: float) -> None:
        super().__init__()
        self.classes, self.strength = classes, strength
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
        found: Tensor = self.head(standardised, level)
        return found.squeeze(2)

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
        counts = torch.tensor([each.shape[-1] for each in inputs])
        rows = torch.cat([each[0].T for each in inputs]).cpu().double()
        labels = labels.cpu()
        mean, deviation = rows.mean(dim=0), rows.std(dim=0, correction=0)
        scale = torch.where(deviation > LEAST_DEVIATION, 1 / deviation, 0)
        rows = (rows - mean) * scale
        owners = torch.repeat_interleave(torch.arange(len(labels)), counts)
        targets = nn.functional.one_hot(labels, self.classes).double()[owners]
        share = targets.mean(dim=0)
        parts = leave_out(labels.tolist(), groups or range(len(labels)))
        alone = not parts
        left_out = torch.arange(len(rows)) % PARTS if alone else torch.tensor(parts)[owners]
        weight, held_out = _ridge(rows, targets - share, self.strength, left_out)
        votes = torch.split(SHARPNESS * (held_out + share), counts.tolist())
        scores = [vote.T if alone else vote.mean(dim=0)[:, None] for vote in votes]
        sharpness = SHARPNESS / fit_temperature(scores, labels.tolist())
        self.mean.copy_(mean[:, None, None])
        self.scale.copy_(scale[:, None, None])
        layer = self.score_layer
        layer.weight.copy_(sharpness * weight.T[:, :, None, None])
        layer.bias = nn.Parameter((sharpness * share).to(layer.weight))


def _ridge(rows: Tensor, targets: Tensor, strength: float, parts: Tensor) -> tuple[Tensor, Tensor]:
    """Weights (D, classes), and what each row gets by weights fitted without its part."""
    ridge = strength * rows.square().sum() / len(rows)
    normal = rows.T @ rows + ridge * torch.eye(rows.shape[1], dtype=rows.dtype)
    moment = rows.T @ targets
    held_out = torch.empty_like(targets)
    for part in set(parts.tolist()):
        out = parts == part
        own = rows[out]
        held_out[out] = own @ _solved(normal - own.T @ own, moment - own.T @ targets[out])
    return _solved(normal, moment), held_out


def _solved(matrix: Tensor, target: Tensor) -> Tensor:
    """The matrix is positive definite."""
    return torch.cholesky_solve(target, torch.linalg.cholesky(matrix))


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

    return float(10 ** minimize_scalar(loss, bounds=(-1, 1), method="bounded").x)
