"""Base classes of baselines: settings, a fit to whole recordings, and class scores.

A scikit-learn estimator is kept as a tensor of bytes, so that a checkpoint holds nothing but
tensors. skops stores what it is made of as a tree of objects, each with its class. It is read only
if every object is of a class that is listed here, and none is a function, a method or a class that
could be called: skops itself would trust more, such as a ``FunctionTransformer``.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from io import BytesIO
from typing import Any, ClassVar, Literal, Self
from zipfile import ZipFile

import numpy as np
import numpy.typing as npt
import skops.io
import torch
from torch import Tensor

from tex_lightning.errors import UserError, listed
from tex_lightning.networks.archives import check_archive

# What plain values and arrays may be, by the way in which skops reads them.
PLAIN = {
    "JsonNode": ("builtins.str",),
    "TypeNode": ("builtins.str", "builtins.int"),  # of keys of a dictionary
    "DictNode": ("builtins.dict",),
    "ListNode": ("builtins.list",),
    "TupleNode": ("builtins.tuple",),
    "NdArrayNode": (
        "numpy.ndarray", "numpy.bool", "numpy.int32", "numpy.int64", "numpy.float32",
        "numpy.float64",
    ),
}  # fmt: skip
OBJECT = "ObjectNode"
ESTIMATORS = (
    "aeon.transformations.collection.convolution_based._minirocket.MiniRocket",
    "sklearn.kernel_approximation.AdditiveChi2Sampler",
    "sklearn.linear_model._logistic.LogisticRegression",
    "sklearn.linear_model._ridge.RidgeClassifierCV",
    "sklearn.mixture._gaussian_mixture.GaussianMixture",
    "sklearn.naive_bayes.GaussianNB",
    "sklearn.pipeline.Pipeline",
    "sklearn.preprocessing._data.StandardScaler",
    "sklearn.preprocessing._label.LabelBinarizer",
)


def dump_estimator(estimator: Any, more: Sequence[str] = ()) -> Tensor:  # noqa: ANN401
    """Return an estimator as a uint8 tensor (bytes,).

    Raises:
        UserError: If :func:`load_estimator` would not read it back.
    """
    content = skops.io.dumps(estimator)
    _check(content, more)
    return torch.from_numpy(np.frombuffer(content, dtype=np.uint8).copy())


def load_estimator(stored: Tensor, more: Sequence[str] = ()) -> Any:  # noqa: ANN401
    """Read an estimator back.

    Args:
        stored: Result of :func:`dump_estimator`.
        more: Classes, beside :data:`ESTIMATORS`, that it may consist of, as ``module.Name``.

    Raises:
        UserError: If it consists of others; nothing of it was made or imported.
    """
    content = stored.numpy().tobytes()
    check_archive(BytesIO(content))
    _check(content, more)
    return skops.io.loads(content, trusted=[*ESTIMATORS, *more])


def _check(content: bytes, more: Sequence[str]) -> None:
    with ZipFile(BytesIO(content)) as archive:
        objects = set(_objects(json.loads(archive.read("schema.json"))))
    allowed = {OBJECT: (*ESTIMATORS, *more), **PLAIN}
    rejected = {name for reader, name in objects if name not in allowed.get(reader, ())}
    if rejected:
        raise UserError(
            f"The estimator holds {listed(sorted(rejected))}, which a checkpoint may not; a "
            "baseline of your own names such classes in estimator_classes; functions, and objects "
            "of C such as trees, cannot be kept."
        )


def _objects(state: object) -> Iterator[tuple[str, str]]:
    """Return for every object of a tree how skops would read it, and its class."""
    if isinstance(state, dict):
        if "__loader__" in state:
            yield str(state["__loader__"]), f"{state['__module__']}.{state['__class__']}"
        state = list(state.values())
    if isinstance(state, list):
        for item in state:
            yield from _objects(item)


FITTED = ("steps", "transformer_list", "parameters", "parameter", "parameter1")  # aeon's too
Array = npt.NDArray[Any]
State = dict[str, Tensor]


@dataclass
class Baseline(ABC):
    """A system that is fitted to all training recordings at once.

    A baseline is one dataclass in one file; its fields are its settings, whose values stand in
    ``conf/model/NAME.yaml``. Traces come as one axis of movement (samples,) float32 at the
    configured rate, to which DFT321 joins several, unless :attr:`axes_apart`; photos as (height,
    width, 3) uint8 RGB.

    Attributes:
        kind: Kind of recordings: ``haptic`` for any signals, ``visual`` for any photos.
        axes_apart: Whether traces of several axes come as (axes, samples).
        min_side: Smallest side in pixels of a photo it can classify; of no meaning for traces.
        sampling_rate: Sampling rate of the traces in Hz; set by the classifier.
        budgeted: Smallest value of each setting that ``debug=tiny`` makes smaller.
    """

    kind: ClassVar[Literal["haptic", "visual"]]
    axes_apart: ClassVar[bool] = False
    budgeted: ClassVar[Mapping[str, int]] = {}
    min_side = 0  # no settings of their own: it follows from the settings,
    sampling_rate = 10_000.0  # and this from data.sampling_rate

    @abstractmethod
    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Fit to recordings with class indices (recordings,), every class present.

        One that takes ``groups`` as well, the group of each recording, is given them: recordings of
        one group are alike, and what is chosen on some of them leaves out whole groups.

        Args:
            recordings: Traces or photos, loaded as they are asked for.
            labels: Their class indices.
            seed: Seed of everything random.
        """

    @abstractmethod
    def logits(self, recording: Array) -> Tensor:
        """Return the class scores (classes, fragments) of one recording, before softmax."""

    @abstractmethod
    def state(self) -> State:
        """Return the fitted values as tensors."""

    @abstractmethod
    def load_state(self, state: State) -> None:
        """Load the values that :meth:`state` returned."""

    @abstractmethod
    def count_parameters(self) -> int:
        """Return how many numbers were fitted."""

    def load_weights(self, source: str) -> str:
        """Start from pretrained weights, before :meth:`fit`.

        Args:
            source: The key ``weights``: a file, an address or ``imagenet``.

        Returns:
            One line saying what was loaded.

        Raises:
            UserError: If there is nothing to load them into, or the file cannot be used.
        """
        raise UserError(
            "weights belong to a visual trunk, which this model does not have: leave it null."
        )

    def with_budget(self, budget: float) -> Self:
        """Return it with all of :attr:`budgeted` multiplied, for ``debug=tiny``."""
        scaled = {
            name: max(least, int(getattr(self, name) * budget))
            for name, least in self.budgeted.items()
        }
        return replace(self, **scaled)


@dataclass
class EstimatorBaseline(Baseline):
    """A baseline whose fitted part is a scikit-learn estimator on the features of each recording.

    Attributes:
        estimator: Any classifier of scikit-learn, fitted by :meth:`fit`.
        estimator_classes: Classes that it consists of, as ``module.Name``, beside
            :data:`ESTIMATORS`.
    """

    estimator_classes: ClassVar[tuple[str, ...]] = ()
    estimator: Any = field(init=False, repr=False, compare=False, default=None)

    @abstractmethod
    def features(self, recording: Array) -> Array:
        """Return the features of one recording, of the same shape for all."""

    @abstractmethod
    def make_estimator(self, seed: int) -> Any:  # noqa: ANN401  (scikit-learn has no types)
        """Return an estimator that is not fitted yet."""

    def fit(self, recordings: Sequence[Array], labels: npt.NDArray[np.int64], seed: int) -> None:
        """Fit the estimator to the features of all recordings."""
        features = np.stack([self.features(recording) for recording in recordings])
        self.estimator = self.make_estimator(seed).fit(features, labels)

    def logits(self, recording: Array) -> Tensor:
        """Return the class scores of one fragment."""
        return class_scores(self.estimator, self.features(recording)[None])

    def state(self) -> State:
        """Return the estimator as bytes."""
        return {"estimator": dump_estimator(self.estimator, self.estimator_classes)}

    def load_state(self, state: State) -> None:
        """Read the estimator back."""
        self.estimator = load_estimator(state["estimator"], self.estimator_classes)

    def count_parameters(self) -> int:
        """Return how many numbers the estimator's fitted arrays hold."""
        return count_fitted(self.estimator)


def class_scores(estimator: Any, features: Array) -> Tensor:  # noqa: ANN401
    """Return log-probabilities (classes, rows) of feature vectors, else distances from planes."""
    tiny = np.finfo(np.float64).tiny
    if hasattr(estimator, "predict_log_proba"):
        scores = np.maximum(estimator.predict_log_proba(features), np.log(tiny))
    elif hasattr(estimator, "predict_proba"):
        scores = np.log(np.maximum(estimator.predict_proba(features), tiny))
    else:
        scores = estimator.decision_function(features)
        if scores.ndim == 1:  # two classes share one plane
            scores = np.stack([-scores, scores], axis=1)
    return torch.from_numpy(np.asarray(scores, dtype=np.float64).T.copy())


def count_fitted(estimator: Any) -> int:  # noqa: ANN401
    """Count the numbers in arrays of an estimator, and of those in it, that end in ``_``."""
    if isinstance(estimator, np.ndarray):
        return estimator.size if estimator.dtype.kind == "f" else 0
    if hasattr(estimator, "get_params") and hasattr(estimator, "__dict__"):
        fitted = vars(estimator).items()
        estimator = [value for key, value in fitted if key.endswith("_") or key in FITTED]
    if isinstance(estimator, dict):
        estimator = list(estimator.values())
    return sum(map(count_fitted, estimator)) if isinstance(estimator, list | tuple) else 0
