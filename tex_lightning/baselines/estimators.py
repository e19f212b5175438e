"""scikit-learn estimators as tensors of bytes, so that a checkpoint holds nothing but tensors.

skops stores what an estimator is made of as a tree of objects, each with its class. It is read
only if every object is of a class that is listed here, and none is a function, a method or a class
that could be called: skops itself would trust more, such as a ``FunctionTransformer``.
"""

import json
from collections.abc import Iterator, Sequence
from io import BytesIO
from typing import Any
from zipfile import ZipFile

import numpy as np
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
        stored: What :func:`dump_estimator` gave.
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
    refused = {name for reader, name in objects if name not in allowed.get(reader, ())}
    if refused:
        raise UserError(
            f"The estimator holds {listed(sorted(refused))}, which a checkpoint may not; a "
            "baseline of your own names such classes in estimator_classes, and functions cannot be "
            "kept."
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
