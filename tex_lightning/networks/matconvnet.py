"""Convolutions of a network published for MatConvNet, out of its ``.mat`` file."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.io

Array = npt.NDArray[np.floating]


def read_matconvnet(path: Path) -> tuple[dict[str, Array], Array | None]:
    """Read ``{layer}.weight`` and ``{layer}.bias`` of all layers, and the mean colour.

    Weights come as (outputs, inputs, height, width), for RGB inputs as MatConvNet has them.

    Returns:
        The arrays, and RGB in 0-255, the mean over the mean image where the file has one; None
        where it has no mean.

    Raises:
        ValueError: If the file holds no such network; SciPy's errors if it is damaged.
    """
    wanted = ("layers", "meta", "normalization", "net")
    content: Mapping[str, Any] = scipy.io.loadmat(path, simplify_cells=True, variable_names=wanted)
    net = content.get("net", content)
    arrays: dict[str, Array] = {}
    for layer in net["layers"]:
        weights = layer.get("weights", ())
        if layer["type"] == "conv" and len(weights) == 2 and np.ndim(weights[0]) == 4:
            arrays[f"{layer['name']}.weight"] = np.ascontiguousarray(
                weights[0].transpose(3, 2, 0, 1)
            )
            arrays[f"{layer['name']}.bias"] = np.ravel(weights[1])
    if not arrays:
        raise ValueError("no convolutions")
    return arrays, _mean(net)


def _mean(net: Mapping[str, Any]) -> Array | None:
    """The mean colour; newer files keep it one level deeper."""
    normalization = net.get("meta", net).get("normalization", {})
    image = np.asarray(normalization.get("averageImage", ()), dtype=np.float64)
    if image.size == 0 or image.shape[-1] != 3:
        return None
    mean: Array = image.reshape(-1, 3).mean(axis=0)
    return mean
