"""MiniRocket: random convolutions, the share of positive values, and a ridge classifier.

Dempster, Schmidt and Webb (2021), as aeon has it; the strongest quick classifier of time series.
"""

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
import numpy.typing as npt
import torch
from aeon.transformations.collection.convolution_based import MiniRocket as Transform
from sklearn.linear_model import RidgeClassifierCV
from sklearn.model_selection import PredefinedSplit
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from torch import Tensor

from tex_lightning.baselines.base import Array, EstimatorBaseline, State
from tex_lightning.core.devices import computing_threads
from tex_lightning.core.groups import leave_out
from tex_lightning.errors import UserError
from tex_lightning_runtime.samples import MAX_SAMPLES

KERNEL = 9  # its samples, before dilation
MIN_KERNELS = 84  # MiniRocket's fixed kernels, each used at least once
ALPHAS = np.logspace(-3, 3, 10)  # of the ridge classifier, as aeon tries them


@dataclass
class MiniRocket(EstimatorBaseline):
    """A pipeline on traces (cases, axes, samples) of mean 0, as long as the longest in training.

    Features are shares of positive values; of several axes a convolution adds up some, as aeon's
    multivariate transform draws them. Shorter traces are repeated from their start, so that all of
    their movement counts; longer ones are cut.

    Attributes:
        threads: For fitting. aeon's loops run over traces, so one trace never uses more than one.
        keep_level: Whether its level counts; else each trace's deviation is made 1, as published,
            by one factor for all axes.
    """

    kernels: Annotated[int, "[1, 10000000]", "number of features"]
    threads: Annotated[int, "[-1, 1024]", "threads of the fit"]
    keep_level: Annotated[bool, "whether the strength of a trace counts"]

    kind: ClassVar = "haptic"
    axes_apart: ClassVar = True
    budgeted: ClassVar = {"kernels": MIN_KERNELS}

    def make_estimator(self, seed: int) -> Any:  # noqa: ANN401
        """Return the pipeline of aeon's ``MiniRocketClassifier``."""
        transform = Transform(n_kernels=self.kernels, n_jobs=self.threads, random_state=seed)
        ridge = RidgeClassifierCV(alphas=ALPHAS, cv=self.divisions)
        return make_pipeline(transform, StandardScaler(with_mean=False), ridge)

    def fit(
        self,
        recordings: Sequence[Array],
        labels: npt.NDArray[np.int64],
        seed: int,
        groups: Sequence[Hashable] = (),
    ) -> None:
        """Draw the kernels' biases from the traces and fit the ridge classifier.

        Its strength is chosen by leaving out traces, as aeon has it, or whole groups of several.

        Raises:
            UserError: If traces have different numbers of axes.
        """
        traces = list(map(np.atleast_2d, recordings))
        self.axes = len(traces[0])
        shared = 0 < len({*groups}) < len(groups)
        parts = leave_out(labels.tolist(), groups) if shared else []
        self.divisions = PredefinedSplit(parts) if max(parts, default=-1) >= 0 else None
        self.length = max(trace.shape[1] for trace in traces)
        variances = [trace.var(axis=1).mean() for trace in traces]
        self.scale = float(np.mean(variances) ** 0.5) or 1.0
        with computing_threads():  # aeon sets them, and Numba by their common OpenMP
            super().fit(traces, labels, seed)
        self.estimator[-1].cv = None  # which a checkpoint need not hold

    def logits(self, recording: Array) -> Tensor:
        """Return distances from the ridge classifier's planes, one fragment."""
        with computing_threads():  # aeon sets them, and Numba by their common OpenMP
            return super().logits(recording)

    def features(self, recording: Array) -> Array:
        """Return the trace (axes, length) of mean 0, and of deviation 1 of itself or the training.

        Raises:
            UserError: If it has another number of axes than those of the training.
        """
        trace = np.atleast_2d(recording)
        if len(trace) != self.axes:
            raise UserError(
                f"The signal has {len(trace)} axes, and MiniRocket was trained on {self.axes}; "
                "give a recording of the same sensor, or choose axes by data.channels."
            )
        piece = np.stack([np.resize(axis, self.length) for axis in trace]).astype(np.float32)
        centred: Array = piece - piece.mean(axis=1, keepdims=True)
        deviation = self.scale if self.keep_level else centred.std()  # one for all axes
        return centred / np.float32(deviation) if deviation > 0 else centred

    def state(self) -> State:
        """Return the pipeline as bytes, and the axes, length and level it was fitted to."""
        sizes = {"axes": torch.tensor(self.axes), "length": torch.tensor(self.length)}
        scale = torch.tensor(self.scale, dtype=torch.float64)
        return {**super().state(), **sizes, "scale": scale}

    def load_state(self, state: State) -> None:
        """Read the pipeline back.

        Raises:
            ValueError: If aeon's compiled code, which checks no bounds, would leave its arrays.
        """
        super().load_state(state)
        self.axes = int(state["axes"]) if "axes" in state else 1
        self.length, self.scale = int(state["length"]), float(state["scale"])
        _check_transform(self.estimator[0], self.axes, self.length)


def _check_transform(transform: Any, axes: int, length: int) -> None:  # noqa: ANN401
    """Reject a transform that no fit to traces of so many axes and samples gives."""
    kinds = (np.int32, np.int32, np.int32, np.int32, np.float32)
    if type(transform) is not Transform or len(transform.parameters) != len(kinds):
        raise ValueError("no MiniRocket")
    for values, kind in zip(transform.parameters, kinds, strict=True):
        if not isinstance(values, np.ndarray) or (values.ndim, values.dtype) != (1, kind):
            raise ValueError("arrays of another kind")
    added, indices, dilations, counts, biases = transform.parameters
    if len(added) != MIN_KERNELS * len(dilations) or added.min() < 1:
        raise ValueError("another number of combinations of axes")
    if len(indices) != added.sum(dtype=np.int64) or not 0 <= indices.min() <= indices.max() < axes:
        raise ValueError("other axes")
    if not 0 < len(dilations) == len(counts) or counts.min() < 0:
        raise ValueError("another number of dilations")
    if len(biases) != MIN_KERNELS * counts.sum(dtype=np.int64):
        raise ValueError("another number of biases")
    if not KERNEL <= length <= MAX_SAMPLES or dilations.min() < 1:
        raise ValueError("traces of another length")
    if (KERNEL - 1) * int(dilations.max()) >= length:
        raise ValueError("kernels longer than the traces")
