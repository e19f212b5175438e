"""State dicts of EfficientNet-Lite, with their normalisation made part of the convolutions."""

from collections.abc import Mapping

import torch
from torch import Tensor

EPSILON = 1e-3  # of the variance, as in TensorFlow's network
# Which normalisation follows a convolution, by the last part of their names.
NORM_AFTER = {
    "_conv_stem": "_bn0",
    "_expand_conv": "_bn0",
    "_depthwise_conv": "_bn1",
    "_project_conv": "_bn2",
}


def fold_statistics(content: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Weight and bias of every convolution that gives what it and its normalisation gave.

    Args:
        content: Tensors by their names in the file.

    Returns:
        ``CONVOLUTION.weight`` and ``CONVOLUTION.bias`` in float64. A convolution whose
        normalisation is not in the file, or is of another size, has no bias.
    """
    folded = {}
    for name, weight in content.items():
        conv, _, kind = name.rpartition(".")
        place, dot, last = conv.rpartition(".")
        if kind != "weight" or last not in NORM_AFTER:
            continue
        folded[name] = weight.double()
        norm = f"{place}{dot}{NORM_AFTER[last]}"
        keys = [f"{norm}.{key}" for key in ("weight", "bias", "running_mean", "running_var")]
        found = [content[key].double() for key in keys if key in content]
        if len(found) == len(keys) and all(each.shape == weight.shape[:1] for each in found):
            gain, shift, mean, variance = found
            scale = gain / torch.sqrt(variance + EPSILON)
            folded[name] = weight.double() * scale[:, None, None, None]
            folded[f"{conv}.bias"] = shift - scale * mean
    return folded
