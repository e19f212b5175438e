"""Improved Fisher vectors of convolutional features and linear SVMs: FV-CNN.

After Cimpoi, Maji and Vedaldi, "Deep filter banks for texture recognition and segmentation"
(CVPR 2015): the last convolution before its ReLU at many scales, pooled over a mixture of
Gaussians.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import reduce
from itertools import count
from typing import ClassVar, Self

import numpy as np
import numpy.typing as npt
import torch
from sklearn.mixture import GaussianMixture
from sklearn.svm import SVC
from threadpoolctl import threadpool_limits
from torch import Tensor, nn

from tex_lightning.baselines.base import Array, Baseline, State
from tex_lightning.core.progress import track
from tex_lightning.errors import UserError
from tex_lightning.networks.trunks import TRUNKS, Trunk, published
from tex_lightning.networks.weights import load_trunk_weights, warn_of_random_weights
from tex_lightning.senses.features.image import ImageFeatures

PREFIX = "trunk."


@dataclass
class TrunkBaseline(Baseline):
    """A baseline on the features of a trunk of VisualNet, which is never trained.

    The trunk has its published width and normalisation. Its weights come from
    :meth:`load_weights`; without them they are drawn at random when it is fitted.

    Attributes:
        trunk: Its name among the trunks of VisualNet.
        max_side: Photos of more than its square in pixels are made smaller, to bound time and
            memory.

    Raises:
        UserError: If there is no such trunk.
    """

    trunk: str
    max_side: int

    kind: ClassVar = "visual"

    def __post_init__(self) -> None:
        if self.trunk not in TRUNKS:
            raise UserError(
                f"model.baseline.trunk={self.trunk} is unknown; choose one of {', '.join(TRUNKS)}."
            )
        self.frozen: Trunk | None = None
        self.pixels = ImageFeatures()
        self.min_side = _least_side(TRUNKS[self.trunk])

    @property
    def network(self) -> Trunk:
        """The trunk, once it has weights."""
        assert self.frozen is not None, "neither fitted nor loaded"
        return self.frozen

    def load_weights(self, source: str) -> str:
        """Fill the trunk; see :func:`~tex_lightning.networks.weights.load_trunk_weights`."""
        trunk = published(self.trunk)
        message = load_trunk_weights(trunk, source)
        self._freeze(trunk)
        return message

    def require_weights(self, seed: int) -> None:
        """Draw the trunk at random unless it was loaded."""
        if self.frozen is not None:
            return
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            self._freeze(published(self.trunk))
        warn_of_random_weights(self.network)

    def _freeze(self, trunk: Trunk) -> None:
        frozen = trunk.eval().requires_grad_(False)
        self.frozen = frozen.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def image(self, photo: Array) -> Tensor:
        """Normalised pixels (1, 3, height, width) of a photo of any size."""
        pixels: Tensor = self.pixels(torch.from_numpy(photo).permute(2, 0, 1)[None])
        return pixels

    def largest_factor(self, image: Tensor) -> float:
        """The factor on an image's sides that brings it to ``max_side``."""
        return self.max_side / math.sqrt(image.shape[-2] * image.shape[-1])

    def maps(self, image: Tensor, layers: Sequence[str]) -> dict[str, Tensor]:
        """Outputs of the trunk's layers of these names; those behind the last are left out."""
        found: dict[str, Tensor] = {}
        for name, layer in self.network.layers.named_children():
            image = layer(image)
            if name in layers:
                found[name] = image
            if len(found) == len(layers):
                break
        return found

    def state(self) -> State:
        """The trunk's tensors."""
        return {PREFIX + name: value for name, value in self.network.state_dict().items()}

    def load_state(self, state: State) -> None:
        """Read the trunk back."""
        trunk = published(self.trunk)
        trunk.load_state_dict(
            {
                name.removeprefix(PREFIX): value
                for name, value in state.items()
                if name.startswith(PREFIX)
            }
        )
        self._freeze(trunk)

    def count_parameters(self) -> int:
        """Weights of the trunk."""
        return sum(parameter.numel() for parameter in self.network.parameters())


def _least_side(trunk: type[Trunk]) -> int:
    """Smallest image side in pixels that the last map before the trunk's pooling is made of."""
    before = trunk.geometry[:-1]
    return next(
        side for side in count(1) if reduce(lambda size, window: window.output(size), before, side)
    )


def resized(image: Tensor, factor: float) -> Tensor:
    """An image (1, 3, height, width) with its sides multiplied, smoothed before it shrinks."""
    size = [max(1, round(side * factor)) for side in image.shape[-2:]]
    return nn.functional.interpolate(image, size, mode="bilinear", antialias=True)


VARIANCE_FLOOR = 1e-4  # of the largest variance of a feature
MIXTURE = ("weights", "means", "variances")
PLANES = ("directions", "offsets")


@dataclass
class FisherVectors(TrunkBaseline):
    """FV-CNN: features of a trunk over scales, Fisher vectors, one linear SVM for each class.

    Attributes:
        scales: Exponents of two of the factors on the photo's sides. A scale is left out where a
            side falls below ``MIN_SIDE`` pixels or the photo grows beyond ``max_side``.
        components: Gaussians of the mixture.
        photos: Most training photos that the mixture is fitted to.
        descriptors: Most features (positions of the map) that each of these gives.
        cost: C of the SVMs.

    Raises:
        UserError: If there is no such trunk, or a number cannot be used.
    """

    scales: list[float]
    components: int
    photos: int
    descriptors: int
    cost: float

    MIN_SIDE: ClassVar = 30

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.scales or min(self.components, self.photos, self.descriptors) < 1:
            raise UserError(
                "model.baseline: scales must not be empty, and components, photos and descriptors "
                "are at least 1."
            )
        if not self.cost > 0:
            raise UserError(f"model.baseline.cost is {self.cost}: choose a positive number.")
        self.map_side = max(self.min_side, self.MIN_SIDE)
        self.min_side = math.ceil(self.map_side / 2 ** max(self.scales))
        self.fitted: State = {}

    def with_budget(self, budget: float) -> Self:
        """Fewer Gaussians and features, and only the scales nearest to the photo's own."""
        kept = max(1, int(len(self.scales) * budget))
        return replace(
            self,
            scales=sorted(self.scales, key=abs)[:kept],
            components=max(2, int(self.components * budget)),
            photos=max(2, int(self.photos * budget)),
            descriptors=max(2, int(self.descriptors * budget)),
        )

    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Fit the mixture to features of some photos, and the SVMs to Fisher vectors of all."""
        self.require_weights(seed)
        rng = np.random.default_rng(seed)
        self.fitted = self._fit_mixture(recordings, rng)
        photos = track(recordings, "Fisher vectors")
        vectors = torch.stack([self.vector(photo) for photo in photos])
        self.fitted |= fit_planes(vectors, labels, self.cost)

    def _fit_mixture(self, recordings: Sequence[Array], rng: np.random.Generator) -> State:
        count = min(self.photos, len(recordings))
        chosen = np.sort(rng.permutation(len(recordings))[:count])
        samples = []
        for index in track(chosen, "Features of the frozen trunk"):
            rows = self.features(recordings[index])
            picked = rng.permutation(len(rows))[: self.descriptors]
            samples.append(rows[torch.from_numpy(picked)])
        features = torch.cat(samples).numpy()
        mixture = GaussianMixture(
            min(self.components, len(features)),
            covariance_type="diag",
            reg_covar=VARIANCE_FLOOR * float(features.var(axis=0).max()),
            random_state=int(rng.integers(2**31)),
        )
        # Its threads wait for each other longer than they compute where others use the processor.
        with threadpool_limits(limits=1):
            mixture.fit(features)
        found = (mixture.weights_, mixture.means_, mixture.covariances_)
        return dict(zip(MIXTURE, (torch.from_numpy(array).float() for array in found), strict=True))

    def factors(self, image: Tensor) -> list[float]:
        """Factors on the sides of an image (1, 3, height, width); at least one."""
        least, largest = self.map_side / min(image.shape[-2:]), self.largest_factor(image)
        factors = [2.0**scale for scale in self.scales]
        return [factor for factor in factors if least <= factor <= largest] or [largest]

    @torch.inference_mode()
    def features(self, photo: Array) -> Tensor:
        """Features (positions, channels) of all scales of a photo."""
        image = self.image(photo)
        rows = [self._features_at(image, factor) for factor in self.factors(image)]
        return torch.cat(rows)

    def _features_at(self, image: Tensor, factor: float) -> Tensor:
        """Outputs of the last convolutions before ReLU, (positions, channels)."""
        trunk = self.network
        outputs: list[Tensor] = []

        def keep(_module: nn.Module, _inputs: object, output: Tensor) -> None:
            outputs.append(output[0].flatten(1).T.clone())  # ReLU will overwrite it

        hooks = [trunk.get_submodule(name).register_forward_hook(keep) for name in trunk.final]
        try:
            self.maps(image if factor == 1 else resized(image, factor), [last_layer(trunk.final)])
        finally:
            for hook in hooks:
                hook.remove()
        return torch.cat(outputs, dim=1)

    @torch.inference_mode()
    def vector(self, photo: Array) -> Tensor:
        """Improved Fisher vector (2 * components * channels,) of a photo."""
        return improved(fisher_vector(self.features(photo), *(self.fitted[key] for key in MIXTURE)))

    def logits(self, recording: Array) -> Tensor:
        """Calibrated scores of the SVMs, one fragment."""
        scores = self.fitted["directions"] @ self.vector(recording) + self.fitted["offsets"]
        return scores[:, None].double()

    def state(self) -> State:
        """Trunk, mixture and planes."""
        return {**super().state(), **self.fitted}

    def load_state(self, state: State) -> None:
        """Read them back."""
        super().load_state(state)
        self.fitted = {key: state[key] for key in (*MIXTURE, *PLANES)}

    def count_parameters(self) -> int:
        """Weights of the trunk, mixture and planes."""
        return super().count_parameters() + sum(value.numel() for value in self.fitted.values())


def last_layer(final: Sequence[str]) -> str:
    """Name of the trunk's layer that its last convolutions are in, as ``layers.conv5.0``."""
    return final[0].split(".")[1]


def fisher_vector(features: Tensor, weights: Tensor, means: Tensor, variances: Tensor) -> Tensor:
    """Gradients of the log-likelihood towards means and variances, in their natural metric.

    With posteriors q, u_k = sum_n q_nk (x_n - m_k) / s_k / (N sqrt(w_k)) and
    v_k = sum_n q_nk (((x_n - m_k) / s_k)^2 - 1) / (N sqrt(2 w_k)), after Perronnin, Sanchez and
    Mensink (ECCV 2010).

    Args:
        features: (N, D).
        weights: Weights of the Gaussians (K,).
        means: (K, D).
        variances: Variances of diagonal covariances (K, D).

    Returns:
        (2 K D,), all u before all v.
    """
    posteriors = _posteriors(features, weights, means, variances)
    count = len(features)
    mass = posteriors.sum(dim=0)[:, None]
    first, second = posteriors.T @ features, posteriors.T @ features.square()
    centred = first - mass * means
    spread = second - 2 * means * first + mass * (means.square() - variances)
    scale = count * weights.sqrt()[:, None]
    u = centred / (scale * variances.sqrt())
    v = spread / (scale * math.sqrt(2) * variances)
    return torch.cat([u.flatten(), v.flatten()])


def _posteriors(features: Tensor, weights: Tensor, means: Tensor, variances: Tensor) -> Tensor:
    """Probabilities (N, K) of the Gaussians given each feature."""
    precision = 1 / variances
    distance = features.square() @ precision.T - 2 * features @ (means * precision).T
    constant = (means.square() * precision).sum(dim=1) + variances.log().sum(dim=1)
    return torch.softmax(weights.log() - 0.5 * (distance + constant), dim=1)


def improved(vector: Tensor) -> Tensor:
    """Signed square root, then length 1 (a vector of zeros stays)."""
    rooted = vector.sign() * vector.abs().sqrt()
    return nn.functional.normalize(rooted, dim=0)


def fit_planes(vectors: Tensor, labels: npt.NDArray[np.int64], cost: float) -> State:
    """One linear SVM for each class against the rest, on vectors (rows, D).

    Scores are brought to a common range: over the training rows, the median is 0 for the others
    and 1 for the class. The SVMs see inner products alone, which are far fewer than the vectors'
    numbers.

    Returns:
        ``directions`` (classes, D) and ``offsets`` (classes,).
    """
    products = (vectors @ vectors.T).numpy().astype(np.float64)
    directions, offsets = [], []
    for label in range(int(labels.max()) + 1):
        own = labels == label
        machine = SVC(kernel="precomputed", C=cost).fit(products, own)
        amounts = np.zeros(len(labels))
        amounts[machine.support_] = machine.dual_coef_[0]
        scores = products @ amounts + machine.intercept_[0]
        others, range_ = np.median(scores[~own]), np.median(scores[own]) - np.median(scores[~own])
        directions.append(torch.from_numpy(amounts / range_).float() @ vectors)
        offsets.append((machine.intercept_[0] - others) / range_)
    return {"directions": torch.stack(directions), "offsets": torch.tensor(offsets).float()}
