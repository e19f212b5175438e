"""Temperature scaling of the probabilities behind a vote (Guo et al., ICML 2017)."""

from collections.abc import Sequence

import torch
from scipy.optimize import minimize_scalar
from torch import Tensor

from tex_lightning.decision.voting import probabilities


def fit_temperature(logits: Sequence[Tensor], labels: Sequence[int]) -> float:
    """The temperature under which mean probabilities over fragments fit the labels best.

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
        means = [probabilities(scores, 10**log_temperature) / scores.shape[1] for scores in logits]
        return float(-(target * torch.stack(means).clamp_min(1e-300).log()).sum() / count)

    return float(10 ** minimize_scalar(loss, bounds=(-1, 1), method="bounded").x)
