"""LinearNet: class scores that are linear in the features of a fragment, fitted in closed form.

A rule with one weight for each feature needs few recordings of a class, and fitting it takes a
moment: ridge regression of the classes on the features, as in MiniRocket (Dempster et al. 2021).
"""

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from tex_lightning.decision.temperature import fit_temperature
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
    def fit(self, inputs: Sequence[Tensor], labels: Tensor) -> None:
        """Fit the scores to all training recordings at once.

        The scores are brought to the size at which the softmax of a recording's mean score is a
        probability: measured on each recording by what the others say of it, or on each fragment
        where a class has but one recording, which flatters.

        Args:
            inputs: Features (1, D, L) of each recording.
            labels: (recordings,) class indices, each at least once.
        """
        counts = torch.tensor([each.shape[-1] for each in inputs])
        rows = torch.cat([each[0].T for each in inputs]).cpu().double()
        labels = labels.cpu()
        mean, deviation = rows.mean(dim=0), rows.std(dim=0, correction=0)
        scale = torch.where(deviation > LEAST_DEVIATION, 1 / deviation, 0)
        rows = (rows - mean) * scale
        targets = nn.functional.one_hot(labels, self.classes).double()
        targets = torch.repeat_interleave(targets, counts, dim=0)
        share = targets.mean(dim=0)
        alone = bool((labels.bincount() == 1).any())
        groups = [1] * len(rows) if alone else counts.tolist()
        weight, held_out = _ridge(rows, targets - share, self.strength, groups)
        parts = _parts(SHARPNESS * (held_out + share), counts.tolist())
        scores = [part.T if alone else part.mean(dim=0)[:, None] for part in parts]
        sharpness = SHARPNESS / fit_temperature(scores, labels.tolist())
        self.mean.copy_(mean[:, None, None])
        self.scale.copy_(scale[:, None, None])
        layer = self.score_layer
        layer.weight.copy_(sharpness * weight.T[:, :, None, None])
        layer.bias = nn.Parameter((sharpness * share).to(layer.weight))


def _ridge(
    rows: Tensor, targets: Tensor, strength: float, groups: list[int]
) -> tuple[Tensor, Tensor]:
    """Weights (D, classes), and what each group of rows gets by weights fitted without it.

    Of fitted values H y those of a group G without its own rows are
    y - (1 - H_GG)^-1 (y - H y) on G.
    """
    ridge = strength * rows.square().sum() / len(rows)
    inverse = torch.linalg.inv(rows.T @ rows + ridge * torch.eye(rows.shape[1], dtype=rows.dtype))
    weight = inverse @ rows.T @ targets
    errors = targets - rows @ weight
    left = []
    for part, error in zip(_parts(rows, groups), _parts(errors, groups), strict=True):
        own = torch.eye(len(part), dtype=rows.dtype) - part @ inverse @ part.T
        left.append(torch.linalg.solve(own, error))
    return weight, targets - torch.cat(left)


def _parts(rows: Tensor, sizes: list[int]) -> tuple[Tensor, ...]:
    return torch.split(rows, sizes)
