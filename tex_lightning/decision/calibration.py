"""Calibration: the temperature of probabilities (Guo et al. 2017) and the novelty of unknowns."""

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


LABEL = "unknown"
ROUNDING = 1e-9  # of a rate times a number of recordings


def novelty_threshold(known: Sequence[float], rate: float) -> float:
    """The novelty above which a recording is called unknown: split conformal prediction.

    If known recordings to come are exchangeable with the n given, each has a chance of at most
    k / (n + 1) to lie above the k-th largest of these (Vovk et al. 2005, Lei et al. 2018). Where
    not even 1 / (n + 1) is as small as ``rate`` the largest is taken, see :func:`least_rate`.

    Args:
        known: Novelties of recordings of known classes that nothing was fitted on, at least one.
        rate: Share of known recordings that may be called unknown, in (0, 1).
    """
    place = max(1, int((len(known) + 1) * rate + ROUNDING))
    return sorted(known)[-place]


def least_rate(known: int) -> float:
    """The smallest rate of false rejections that so many recordings can guarantee."""
    return 1 / (known + 1)
