"""Fit FC3 alone, where it scores the features of a pretrained trunk as they are.

Multinomial logistic regression on the mean features of whole photos: the score of a mean is the
mean of the scores, so that what is fitted is the photo's mean score over all its fragments, of
which any one may show little of the material. With a few hundred photos this beats hidden layers
trained on single fragments, and takes seconds.
"""

import numpy as np
import numpy.typing as npt
import torch
from threadpoolctl import threadpool_limits
from torch import Tensor

from tex_lightning.data.banks import PhotoBank, mirrored, random_corner
from tex_lightning.learning.base import SurfaceModule
from tex_lightning.networks.trunks.textures import TextureFeatures
from tex_lightning.progress import track

Pixels = npt.NDArray[np.uint8]


def fit_linear_head(
    module: SurfaceModule, photos: PhotoBank, labels: npt.NDArray[np.int64]
) -> None:
    """Set FC3 of ``module``'s network, which has neither FC1 nor FC2.

    Args:
        module: With pretrained weights in the trunk, on the device that computes the features.
        photos: Of the training set, perturbed if that has an augmentation.
        labels: Class index of each; every class occurs.
    """
    # a sixth of the time of the command line's start, and only this needs it
    from sklearn.linear_model import LogisticRegression

    recipe = module.fit_config["probe"]
    module.network.trunk.eval()
    targets = np.tile(labels, recipe["passes"])
    numbers = track(range(len(targets)), "Features of the pretrained trunk")
    raw = torch.stack([_mean_features(module, _view(photos, each, module)) for each in numbers])
    last: TextureFeatures = module.network.trunk.layers[-1]
    features = last.standardise(raw)
    scale = features.shape[1] ** 0.5  # to unit variance, which strength and tolerance are meant for
    regression = LogisticRegression(C=recipe["strength"], tol=1e-4, max_iter=1000)
    with threadpool_limits(limits=1):  # on so few rows threads wait for each other
        regression.fit(features.cpu().double().numpy() * scale, targets)
    _set_scores(module, regression.coef_ * scale, regression.intercept_)


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
    branch = next(iter(module.classifier.branches.values()))
    features: Tensor = module.network.trunk(branch(torch.from_numpy(view)))
    return features.mean(dim=(0, 2, 3))


@torch.no_grad()
def _set_scores(
    module: SurfaceModule, weights: npt.NDArray[np.float64], biases: npt.NDArray[np.float64]
) -> None:
    if len(weights) == 1:  # of two classes scikit-learn keeps the difference
        weights, biases = (np.concatenate([-each, each]) / 2 for each in (weights, biases))
    layer = module.network.head.score_layer
    layer.weight.copy_(torch.from_numpy(weights)[:, :, None, None])
    layer.bias.copy_(torch.from_numpy(biases))
