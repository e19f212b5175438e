"""Improved Fisher vectors of convolutional features and linear SVMs: FV-CNN.

After Cimpoi, Maji and Vedaldi, "Deep filter banks for texture recognition and segmentation"
(CVPR 2015): the last convolution before its ReLU at many scales, pooled over a mixture of
Gaussians.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar, Self

import numpy as np
import numpy.typing as npt
import torch
from sklearn.mixture import GaussianMixture
from sklearn.svm import SVC
from threadpoolctl import threadpool_limits
from torch import Tensor, nn

from tex_lightning.baselines.base import Array, Baseline, State
from tex_lightning.core.progress import track
from tex_lightning.networks.geometry import layer_windows, smallest_side
from tex_lightning.networks.trunks import Trunk, published
from tex_lightning.networks.weights import load_trunk_weights, warn_of_random_weights
from tex_lightning.senses.features.image import ImageFeatures

PREFIX = "trunk."
VARIANCE_FLOOR = 1e-4  # of the largest variance of a feature
MIXTURE = ("weights", "means", "variances")
PLANES = ("directions", "offsets")


@dataclass
class FisherVectors(Baseline):
    """FV-CNN: features of a trunk over scales, Fisher vectors, one linear SVM for each class.

    The trunk has its published width and normalisation, and is never trained. Its weights come from
    :meth:`load_weights`; without them they are drawn at random when it is fitted.

    Attributes:
        max_side: Photos of more than its square in pixels are made smaller, to bound time and
            memory.
        scales: Exponents of two of the factors on the photo's sides. A scale is left out where a
            side falls below ``MIN_SIDE`` pixels or the photo grows beyond ``max_side``.
        descriptors: Most features (positions of the map) that each photo gives the mixture.
    """

    trunk: Annotated[str, "name of a trunk of VisualNet"]
    max_side: Annotated[int, "[30, 100000] pixels", "photos of more than its square are shrunk"]
    scales: Annotated[list[float], "[-10, 10]", "exponents of two of factors on a photo's sides"]
    components: Annotated[int, "[1, 10000]", "Gaussians of the mixture"]
    photos: Annotated[int, "[1, 1000000]", "most photos that these are fitted to"]
    descriptors: Annotated[int, "[1, 1000000]", "most features of each of these"]
    cost: Annotated[float, "(0, inf)", "C of the SVMs"]

    kind: ClassVar = "visual"
    budgeted: ClassVar = dict.fromkeys(("components", "photos", "descriptors"), 2)
    MIN_SIDE: ClassVar = 30

    def __post_init__(self) -> None:
        self.frozen: Trunk | None = None
        self.pixels = ImageFeatures()
        with torch.device("meta"):
            *before, _ = layer_windows(published(self.trunk).layers, 0)  # without its pooling
        self.map_side = max(smallest_side(before), self.MIN_SIDE)
        self.min_side = math.ceil(self.map_side / 2 ** max(self.scales))
        self.fitted: State = {}

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

    def with_budget(self, budget: float) -> Self:
        """Return a copy with fewer Gaussians, features and scales: those nearest to the photo's."""
        kept = max(1, int(len(self.scales) * budget))
        return replace(super().with_budget(budget), scales=sorted(self.scales, key=abs)[:kept])

    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Fit the mixture to features of some photos, and the SVMs to Fisher vectors of all."""
        self.require_weights(seed)
        rng = np.random.default_rng(seed)
        self.fitted = self._fit_mixture(recordings, rng)
        photos = track(recordings, "Fisher vectors")
        vectors = torch.stack([self.vector(photo) for photo in photos])
        self.fitted |= fit_planes(vectors, labels, self.cost)

    def _fit_mixture(self, recordings: Sequence[Array], rng: np.random.Generator) -> State:
        chosen = np.sort(rng.permutation(len(recordings))[: self.photos])
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
        fitted = (mixture.weights_, mixture.means_, mixture.covariances_)
        arrays = (torch.from_numpy(array).float() for array in fitted)
        return dict(zip(MIXTURE, arrays, strict=True))

    def factors(self, height: int, width: int) -> list[float]:
        """Return factors on the sides of a photo; at least one."""
        least, largest = self.map_side / min(height, width), self.max_side / (height * width) ** 0.5
        factors = [2.0**scale for scale in self.scales]
        return [factor for factor in factors if least <= factor <= largest] or [largest]

    @torch.inference_mode()
    def features(self, photo: Array) -> Tensor:
        """Return features (positions, channels) of all scales of a photo of any size."""
        image = self.pixels(torch.from_numpy(photo).permute(2, 0, 1)[None])
        sizes = [
            [max(1, round(side * factor)) for side in photo.shape[:2]]
            for factor in self.factors(*photo.shape[:2])
        ]
        rows = [self._last_maps(_resized(image, size))[0].flatten(1).T for size in sizes]
        return torch.cat(rows)

    def _last_maps(self, image: Tensor) -> Tensor:
        """Return outputs of the last convolutions before ReLU (1, channels, rows, columns)."""
        last = self.network.final[0].split(".")[1]  # as layers.conv5.0
        for name, layer in self.network.layers.named_children():
            if name == last:
                maps: Tensor = self.network.get_submodule(self.network.final[0])(image)
                return maps
            image = layer(image)
        raise ValueError(f"{self.trunk} has no layer {last}")

    @torch.inference_mode()
    def vector(self, photo: Array) -> Tensor:
        """Return the improved Fisher vector (2 * components * channels,) of a photo."""
        return improved(fisher_vector(self.features(photo), *(self.fitted[key] for key in MIXTURE)))

    def logits(self, recording: Array) -> Tensor:
        """Return calibrated scores of the SVMs, one fragment."""
        scores = self.fitted["directions"] @ self.vector(recording) + self.fitted["offsets"]
        return scores[:, None].double()

    def state(self) -> State:
        """Return trunk, mixture and planes."""
        trunk = self.network.state_dict().items()
        return {**{PREFIX + name: value for name, value in trunk}, **self.fitted}

    def load_state(self, state: State) -> None:
        """Read them back."""
        trunk, stored = published(self.trunk), state.items()
        trunk.load_state_dict(
            {key.removeprefix(PREFIX): value for key, value in stored if key.startswith(PREFIX)}
        )
        self._freeze(trunk)
        self.fitted = {key: state[key] for key in (*MIXTURE, *PLANES)}

    def count_parameters(self) -> int:
        """Count the weights of trunk, mixture and planes."""
        tensors = [*self.network.parameters(), *self.fitted.values()]
        return sum(value.numel() for value in tensors)


def _resized(image: Tensor, size: list[int]) -> Tensor:
    """Return an image (1, 3, height, width) of another size, smoothed before it shrinks."""
    if size == list(image.shape[-2:]):
        return image
    return nn.functional.interpolate(image, size, mode="bilinear", antialias=True)


def fisher_vector(features: Tensor, weights: Tensor, means: Tensor, variances: Tensor) -> Tensor:
    """Return gradients of the log-likelihood towards means and variances, in their natural metric.

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
    precision = 1 / variances
    distance = features.square() @ precision.T - 2 * features @ (means * precision).T
    constant = (means.square() * precision).sum(dim=1) + variances.log().sum(dim=1)
    posteriors = torch.softmax(weights.log() - 0.5 * (distance + constant), dim=1)
    count = len(features)
    mass = posteriors.sum(dim=0)[:, None]
    first, second = posteriors.T @ features, posteriors.T @ features.square()
    centred = first - mass * means
    spread = second - 2 * means * first + mass * (means.square() - variances)
    scale = count * weights.sqrt()[:, None]
    u = centred / (scale * variances.sqrt())
    v = spread / (scale * math.sqrt(2) * variances)
    return torch.cat([u.flatten(), v.flatten()])


def improved(vector: Tensor) -> Tensor:
    """Return the signed square root, scaled to length 1 (a vector of zeros stays)."""
    rooted = vector.sign() * vector.abs().sqrt()
    return nn.functional.normalize(rooted, dim=0)


def fit_planes(vectors: Tensor, labels: npt.NDArray[np.int64], cost: float) -> State:
    """Fit one linear SVM for each class against the rest, on vectors (rows, D).

    Scores are brought to a common range: over the training rows, the median is 0 for the others
    and 1 for the class. The SVMs see inner products alone, which are far fewer than the vectors'
    numbers.

    Returns:
        ``directions`` (classes, D) and ``offsets`` (classes,).
    """
    products = (vectors @ vectors.T).numpy().astype(np.float64)
    directions, offsets = [], []
    for label in range(int(labels.max()) + 1):
        is_class = labels == label
        machine = SVC(kernel="precomputed", C=cost).fit(products, is_class)
        amounts = np.zeros(len(labels))
        amounts[machine.support_] = machine.dual_coef_[0]
        scores = products @ amounts + machine.intercept_[0]
        others = np.median(scores[~is_class])
        range_ = np.median(scores[is_class]) - others
        directions.append(torch.from_numpy(amounts / range_).float() @ vectors)
        offsets.append((machine.intercept_[0] - others) / range_)
    return {"directions": torch.stack(directions), "offsets": torch.tensor(offsets).float()}
