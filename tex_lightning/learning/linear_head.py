"""Fit the class scores of a VisualNet without hidden layers to whole photos, in closed form."""

import hashlib
import json
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from threadpoolctl import threadpool_limits
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.core.groups import leave_out
from tex_lightning.core.progress import track
from tex_lightning.data.banks import PhotoBank, mirrored, random_corner
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store
from tex_lightning.inference.engine import accelerate
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.networks.linear import LinearNet
from tex_lightning.networks.temperature import sharpness_of
from tex_lightning.networks.trunks.efficientnet_lite import TextureFeatures
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning_runtime.samples import content_seed

Pixels = npt.NDArray[np.uint8]
Labels = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


def scores_textures(network: nn.Module) -> bool:
    """Return whether FC3 takes the texture features of a trunk, without FC1 and FC2 between."""
    return isinstance(network, VisualNet) and not network.has_hidden_layers


def fits_probabilities(classifier: SurfaceClassifier) -> bool:
    """Return whether a fit in closed form has calibrated its scores, on groups that it left out."""
    if classifier.fusion is not None:
        return False
    network = classifier.network
    return scores_textures(network) or isinstance(network, LinearNet)


def fit_linear_head(
    module: SurfaceModule,
    photos: PhotoBank,
    labels: Labels,
    groups: Sequence[str],
    engine: EngineConfig,
) -> None:
    """Fit FC3 of a VisualNet without FC1 and FC2: multinomial logistic regression.

    It is fitted to the mean features of whole photos. Since FC3 is linear, the score of a mean is
    the mean score of the photo's fragments, any of which may show little of the material. With a
    few hundred photos this is more accurate than hidden layers trained on single fragments, and
    takes seconds.

    With few photos the penalty makes the scores too small, and so too unconfident. They are scaled
    until the confidence in left-out groups of photos equals the accuracy there.

    Args:
        module: Module of the VisualNet with a pretrained trunk, on the device that computes.
        photos: Photos of the training set, with an augmentation if they are to be perturbed.
        labels: Class index of each photo; every class occurs.
        groups: Group of each photo.
        engine: Settings of the accelerated copy that computes the features.
    """
    recipe = module.fit_config["probe"]
    module.network.trunk.eval()
    numbers = np.tile(np.arange(len(labels)), recipe["passes"])
    raw = _view_features(module, photos, recipe["passes"], engine)
    last: TextureFeatures = module.network.trunk.layers[-1]
    features = last.standardise(raw)
    scale = features.shape[1] ** 0.5  # to unit variance, which strength and tolerance are meant for
    rows = scale * features.cpu().double().numpy()
    fit = partial(_regression, strength=recipe["strength"])
    with threadpool_limits(limits=1):  # on so few rows threads wait for each other
        weights, biases = fit(rows, labels[numbers])
        parts = np.array(leave_out(labels.tolist(), groups))
        sharpness = _sharpness(fit, rows, labels[numbers], parts[numbers])
    layer = module.network.head.score_layer
    with torch.no_grad():
        layer.weight.copy_(torch.from_numpy(sharpness * scale * weights)[:, :, None, None])
        layer.bias.copy_(torch.from_numpy(sharpness * biases))


def _sharpness(
    fit: Callable[[Floats, Labels], tuple[Floats, Floats]],
    rows: Floats,
    targets: Labels,
    parts: Labels,
) -> float:
    """Return the factor that makes the scores of left-out photos as confident as accurate.

    It is 1 if no photo can be left out, since every class has only one. ``fit`` fits weights and
    biases to ``rows``, features (views, D) of views of the photos, and ``targets``, their class
    indices; ``parts`` number the part with which each is left out, -1 leaves it in always.
    """
    tested = parts >= 0
    if not tested.any():
        return 1.0
    scores = np.empty((len(rows), targets.max() + 1))
    for part in np.unique(parts[tested]):
        out = parts == part
        weights, biases = fit(rows[~out], targets[~out])
        scores[out] = rows[out] @ weights.T + biases
    left_out, labels, numbers = map(torch.from_numpy, (scores, targets, parts))
    return sharpness_of(left_out, labels, numbers, about=1.0)


def _regression(rows: Floats, targets: Labels, strength: float) -> tuple[Floats, Floats]:
    """Return weights (classes, D) and biases (classes,)."""
    # a sixth of the time of the command line's start, and only this needs it
    from sklearn.linear_model import LogisticRegression

    model = LogisticRegression(C=strength, tol=1e-4, max_iter=1000).fit(rows, targets)
    weights, biases = model.coef_, model.intercept_
    if len(weights) == 1:  # of two classes scikit-learn keeps the difference
        return np.concatenate([-weights, weights]) / 2, np.concatenate([-biases, biases]) / 2
    return weights, biases


class FrozenTrunk:
    """Mean texture features of photos by a trunk that no training changes.

    The store caches them for the next fold, run or classifier with this trunk.

    Args:
        fast: Accelerated copy of a classifier. The standardisation of its trunk's features is
            switched off, since it depends on the training set.
        name: Name of the sense with the trunk.
    """

    def __init__(self, fast: SurfaceClassifier, name: str) -> None:
        self.sense = fast.senses[name]
        trunk: Any = self.sense.network.trunk
        last: TextureFeatures = trunk.layers[-1]
        last.mean.zero_()
        last.scale.fill_(1)
        digest = hashlib.sha256(json.dumps(fast.card.senses[name], sort_keys=True).encode())
        digest.update(fast.device.type.encode())
        for tensor in trunk.state_dict().values():
            digest.update(tensor.cpu().contiguous().numpy().data)
        self.digest = digest.hexdigest()

    @torch.no_grad()
    def mean(self, view: Pixels) -> npt.NDArray[np.float32]:
        """Return features (D,) of a photo (height, width, 3), the mean over its fragments."""
        photo = torch.from_numpy(np.array(mirrored(view, self.sense.window_size[0])))
        mean: npt.NDArray[np.float32] = self.sense.positions(photo, "fc2").mean(dim=1).cpu().numpy()
        return mean

    def kept(self, view: Pixels, corner: tuple[int, int], row: Recording, store: Store) -> Tensor:
        """Return the features of a piece of a recording, cached in the store."""
        key = hashlib.sha256(f"{self.digest} {corner} {view.shape}".encode()).hexdigest()[:16]
        return torch.from_numpy(store.derived(row, key, lambda: self.mean(view)))


def _view_features(
    module: SurfaceModule, photos: PhotoBank, passes: int, engine: EngineConfig
) -> Tensor:
    """Return features (passes * photos, D) of a view of each photo, pass by pass."""
    trunk = FrozenTrunk(accelerate(module.classifier, engine), module.kind)
    numbers = [(part, index) for part in range(passes) for index in range(len(photos.recordings))]
    features = []
    for part, index in track(numbers, "Features of the pretrained trunk"):
        corner, view = _view(photos, index, part, module)
        if photos.augmentation is None:
            row = photos.recordings[index]
            features.append(trunk.kept(view, corner, row, photos.store))
        else:
            features.append(torch.from_numpy(trunk.mean(view)))
    return torch.stack(features).to(module.device)


def _view(
    photos: PhotoBank, index: int, part: int, module: SurfaceModule
) -> tuple[tuple[int, int], Pixels]:
    """Return a view of a photo, and its top left corner; of a large photo it is a random crop."""
    photo, side = photos.photo(index), module.fit_config["probe"]["side"]
    rng = np.random.default_rng([content_seed(module.seed, photo), part])
    top, left = random_corner(photo.shape, side, rng)
    view = np.array(photo[top : top + side, left : left + side])
    if photos.augmentation is not None:
        view = photos.augmentation(view, rng)
    return (top, left), view
