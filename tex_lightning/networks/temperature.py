"""The scale of class scores at which their probabilities fit the labels best."""

from collections.abc import Sequence

import scipy  # whose parts are loaded when they are used
import torch
from torch import Tensor

from tex_lightning.core.devices import with_float64


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
