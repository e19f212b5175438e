"""Fit FC3 of a VisualNet without hidden layers on fixed features of a pretrained trunk.

It is a multinomial logistic regression on the mean features of whole photos. The score of a mean is
the mean of the scores, so that the photo's mean score over all its fragments is fitted, of which
any one may show little of the material. With a few hundred photos this beats hidden layers trained
on single fragments, and takes seconds.

The penalty keeps the scores of few photos small: of little confidence even where they are correct,
and of little weight beside another sense. So they are scaled until the confidence in groups of
photos that are left out of the fit, one part after the other, matches the accuracy.
"""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import numpy.typing as npt
import torch
from threadpoolctl import threadpool_limits
from torch import Tensor

from tex_lightning.core.groups import leave_out
from tex_lightning.core.progress import track
from tex_lightning.data.banks import PhotoBank, mirrored, random_corner
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.linear import fit_temperature
from tex_lightning.networks.trunks.efficientnet_lite import TextureFeatures

Pixels = npt.NDArray[np.uint8]
Labels = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


def fit_linear_head(
    module: SurfaceModule, photos: PhotoBank, labels: Labels, groups: Sequence[str]
) -> None:
    """Set FC3 of ``module``'s network, which has neither FC1 nor FC2.

    Args:
        module: With pretrained weights in the trunk, on the device that computes the features.
        photos: Photos of the training set, perturbed if that has an augmentation.
        labels: Class index of each; every class occurs.
        groups: What was recorded together, of each photo.
    """
    recipe = module.fit_config["probe"]
    module.network.trunk.eval()
    numbers = np.tile(np.arange(len(labels)), recipe["passes"])
    views = track(range(len(numbers)), "Features of the pretrained trunk")
    raw = torch.stack([_mean_features(module, _view(photos, each, module)) for each in views])
    last: TextureFeatures = module.network.trunk.layers[-1]
    features = last.standardise(raw)
    scale = features.shape[1] ** 0.5  # to unit variance, which strength and tolerance are meant for
    rows = scale * features.cpu().double().numpy()
    fit = partial(_regression, strength=recipe["strength"])
    with threadpool_limits(limits=1):  # on so few rows threads wait for each other
        weights, biases = fit(rows, labels[numbers])
        parts = np.array(leave_out(labels.tolist(), groups))
        sharpness = _sharpness(fit, rows, labels[numbers], parts[numbers]) if len(parts) else 1.0
    _set_scores(module, sharpness * scale * weights, sharpness * biases)


def _sharpness(
    fit: Callable[[Floats, Labels], tuple[Floats, Floats]],
    rows: Floats,
    targets: Labels,
    parts: Labels,
) -> float:
    """What makes scores of photos that were left out of the fit as confident as they are right.

    Args:
        fit: Gives weights and biases.
        rows: Features of views of the photos.
        targets: Class index of each view.
        parts: The part in which each view is left out.
    """
    scores = np.empty((len(rows), targets.max() + 1))
    for part in np.unique(parts):
        out = parts == part
        weights, biases = fit(rows[~out], targets[~out])
        scores[out] = rows[out] @ weights.T + biases
    return 1 / fit_temperature(list(torch.from_numpy(scores)[:, :, None]), targets.tolist())


def _regression(rows: Floats, targets: Labels, strength: float) -> tuple[Floats, Floats]:
    """Weights (classes, D) and biases (classes,)."""
    # a sixth of the time of the command line's start, and only this needs it
    from sklearn.linear_model import LogisticRegression

    found = LogisticRegression(C=strength, tol=1e-4, max_iter=1000).fit(rows, targets)
    weights, biases = found.coef_, found.intercept_
    if len(weights) == 1:  # of two classes scikit-learn keeps the difference
        return np.concatenate([-weights, weights]) / 2, np.concatenate([-biases, biases]) / 2
    return weights, biases


def _view(photos: PhotoBank, number: int, module: SurfaceModule) -> Pixels:
    """The next photo in turn, of a large one a random piece."""
    rng = np.random.default_rng([module.seed, number])
    photo, side = photos.photo(number % len(photos.recordings)), module.fit_config["probe"]["side"]
    top, left = random_corner(photo, side, rng)
    view = np.array(photo[top : top + side, left : left + side])
    if photos.augmentation is not None:
        view = photos.augmentation(view, rng)
    return mirrored(view, module.network.window_size[0])


@torch.no_grad()
def _mean_features(module: SurfaceModule, view: Pixels) -> Tensor:
    """Features (D,) of a photo, mean over its fragments."""
    sense = next(iter(module.classifier.senses.values()))
    features: Tensor = module.network.trunk(sense(torch.from_numpy(view)))
    return features.mean(dim=(0, 2, 3))


@torch.no_grad()
def _set_scores(module: SurfaceModule, weights: Floats, biases: Floats) -> None:
    layer = module.network.head.score_layer
    layer.weight.copy_(torch.from_numpy(weights)[:, :, None, None])
    layer.bias.copy_(torch.from_numpy(biases))
