"""Reading ImageNet weights of VisualNet's trunks, from Caffe and torchvision layouts."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.errors import UserError
from tex_lightning.features.image import MEAN, STD
from tex_lightning.networks.trunks import TRUNKS, Trunk
from tex_lightning.networks.trunks.base import Layout
from tex_lightning.networks.visualnet import VisualNet

CAFFE_MEAN = (123.0, 117.0, 104.0)  # RGB, subtracted from values in 0-255

LAYOUT_OF_SUFFIX: dict[str, Layout] = {
    ".npz": "caffe",
    ".pth": "torchvision",
    ".pt": "torchvision",
}


def load_trunk_weights(visual: VisualNet, source: str | Path) -> str:
    """Load ImageNet weights into the trunk of ``visual``; its head stays as it is.

    The features are the published ones divided by one number, so that their root mean square on
    noise is 1: SqueezeNet's reach 1000, with which a freshly drawn head does not train.

    Args:
        visual: A network of width 1 without batch normalisation.
        source: A .npz file in the Caffe layout (its input convention, BGR in 0-255 less the mean,
            is folded into the first convolution, so that the network keeps the input it
            documents), a .pth or .pt state dict with torchvision's names, "imagenet" for the
            trunk's official weights, or their address. The official file is fetched once and
            kept in the folder of torch.hub.

    Returns:
        One line saying what was loaded.

    Raises:
        UserError: The file is missing, unreadable or of another network, cannot be fetched, or
            the trunk cannot take it.
    """
    trunk = visual.trunk
    _check_trunk(trunk)
    path = _find(trunk, str(source))
    layout = LAYOUT_OF_SUFFIX.get(path.suffix)
    if layout is None:
        raise UserError(f"weights: {path} must end in .npz, .pth or .pt.")
    if layout not in trunk.layouts:
        raise UserError(
            f"weights: {path} is in the {layout} layout, which {_name(trunk)} does not have; use"
            f" {' or '.join(s for s, known in LAYOUT_OF_SUFFIX.items() if known in trunk.layouts)}"
            " or another model.visual.trunk."
        )
    state = _select(trunk, _read(path), layout, path)
    if layout == "caffe":
        _fold_caffe_input(state, "layers.conv1.0")
    trunk.load_state_dict(state)
    _scale_features(trunk)
    return f"{_name(trunk)} trunk from {path} ({layout} layout, {len(state)} tensors)"


def _name(trunk: Trunk) -> str:
    return next(name for name, known in TRUNKS.items() if known is type(trunk))


def _check_trunk(trunk: Trunk) -> None:
    if trunk.width != 1:
        raise UserError(
            f"weights: pretrained weights need model.visual.width=1, not {trunk.width}."
        )
    if trunk.norm == "batch":
        allowed = " or ".join(norm for norm in trunk.norms if norm != "batch")
        raise UserError(
            "weights: pretrained weights do not fit a trunk with batch normalisation; set"
            f" model.visual.norm={allowed}."
        )


def _find(trunk: Trunk, source: str) -> Path:
    """Return the file that ``source`` names, after fetching it where it is an official one."""
    if source != "imagenet" and "://" not in source:
        path = Path(source).expanduser()
        if not path.is_file():
            raise UserError(f"weights: there is no file {path}; give the path of a weight file.")
        return path
    url = trunk.imagenet_url
    if url is None:
        raise UserError(
            f"weights={source} is not available for {_name(trunk)}; give weights=PATH of a .npz"
            " file in the Caffe layout."
        )
    if source not in ("imagenet", url):
        raise UserError(f"weights={source} is not an official file of this trunk; use {url}.")
    return _fetch(url)


def _fetch(url: str) -> Path:
    path = Path(torch.hub.get_dir()) / "checkpoints" / url.rpartition("/")[2]
    if path.is_file():
        return path
    # The official file names end in the first digits of their SHA-256.
    digits = re.search(r"-([0-9a-f]+)\.", path.name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.hub.download_url_to_file(
            url, str(path), hash_prefix=digits and digits[1], progress=False
        )
    except (OSError, RuntimeError) as error:
        raise UserError(
            f"weights: could not fetch {url} ({error}); put the file at {path} or give"
            " weights=PATH."
        ) from error
    return path


def _read(path: Path) -> Mapping[str, Tensor]:
    try:
        if path.suffix == ".npz":
            # Opened here because NumPy leaves a damaged file open.
            with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                return {name: torch.from_numpy(arrays[name]) for name in arrays.files}
        content: Any = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # zip, zlib, pickle and NumPy each raise their own kinds
        raise UserError(
            f"weights: {path} cannot be read, it may be truncated or not a weight file; replace it."
        ) from error
    if not isinstance(content, Mapping) or not all(
        isinstance(value, Tensor) for value in content.values()
    ):
        raise UserError(f"weights: {path} must hold a state dict, names with their tensors.")
    return content


def _select(
    trunk: Trunk, content: Mapping[str, Tensor], layout: Layout, path: Path
) -> dict[str, Tensor]:
    """Return the trunk's state dict out of the file; what belongs to a classifier is left."""
    expected = trunk.state_dict()
    state = {}
    for theirs, ours in trunk.layouts[layout].items():
        for kind in ("weight", "bias"):
            name, target = f"{theirs}.{kind}", f"{ours}.{kind}"
            shape = tuple(expected[target].shape)
            if name not in content:
                raise UserError(
                    f"weights: {path} has no {name}, so it is not a {layout} file of"
                    f" {_name(trunk)}; give another file or another model.visual.trunk."
                )
            if tuple(content[name].shape) != shape:
                raise UserError(
                    f"weights: {name} in {path} has shape {tuple(content[name].shape)} but"
                    f" {_name(trunk)} needs {shape}; give another file or another"
                    " model.visual.trunk."
                )
            state[target] = content[name].float()
            if not state[target].isfinite().all():
                raise UserError(f"weights: {name} in {path} is not finite; replace the file.")
    return state


def _fold_caffe_input(state: dict[str, Tensor], conv1: str) -> None:
    """Change the first convolution from Caffe's input to the normalised RGB of VisualNet.

    Caffe's input in channel c is 255 (SD_c x_c + mean_c) - m_c. Factor and constant move into the
    weights and the bias; this is exact because the first convolution has no padding.
    """
    weight = state[f"{conv1}.weight"].flip(1).double()  # BGR to RGB
    mean, sd, caffe_mean = (
        torch.tensor(values, dtype=torch.float64) for values in (MEAN, STD, CAFFE_MEAN)
    )
    shift = (weight.sum(dim=(2, 3)) * (255 * mean - caffe_mean)).sum(dim=1)
    state[f"{conv1}.weight"] = (weight * (255 * sd)[:, None, None]).float()
    state[f"{conv1}.bias"] = (state[f"{conv1}.bias"].double() + shift).float()


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
