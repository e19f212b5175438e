"""A trained network as a page for the browser: a folder of files for any file server.

The page runs on ONNX Runtime Web, from the npm registry or from a machine's own copy.
"""

import base64
import hashlib
import io
import json
import os
import shutil
import subprocess
import tarfile
import tempfile
import urllib.request
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from tex_lightning.core.files import write_bytes
from tex_lightning.errors import UserError

RUNTIME = "onnxruntime"  # its folder in the page's
CARD = "model.json"


def page_files(metadata: Mapping[str, Any], runtime: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files of the page around the network ``KIND.onnx``, by their paths in its folder.

    Every input of that file has to be given: ONNX Runtime Web takes none that has a default.

    Args:
        metadata: What the file says of itself.
        runtime: Files of ONNX Runtime Web by name.
    """
    sources = files("tex_lightning.export").joinpath("web")
    content = {_place(each.name): each.read_bytes() for each in sources.iterdir()}
    content |= {f"{RUNTIME}/{name}": each for name, each in runtime.items()}
    content[f"{RUNTIME}/LICENSE.txt"] = content.pop("onnxruntime_license.txt")
    content[CARD] = json.dumps(metadata).encode()
    return content


def _place(name: str) -> str:
    """The path of a source in the page's folder."""
    return f"script/{name}" if name.endswith(".js") else name


NAME, VERSION = "onnxruntime-web", "1.30.0"
INTEGRITY = (  # as the registry gives it: npm view onnxruntime-web@VERSION dist.integrity
    "sha512-q0y+JrrtukXSzsBWEMccVfqX25LRmosXHF+CaRJmg8pZClzcV7svNc4rKY3jL02Vb7QmRMDs1SigqR4CXAfKYQ=="
)
REGISTRY = "https://registry.npmjs.org/"
TIMEOUT = 300  # s, for 33 MB
RETRIES = ("--fetch-retries=1", "--fetch-retry-mintimeout=1000")  # its own take a minute
# By their names in the package. File servers know .js, and not all of them .mjs.
FILES = {
    "ort.wasm.bundle.min.mjs": "ort.wasm.bundle.min.js",
    "ort-wasm-simd-threaded.wasm": "ort-wasm-simd-threaded.wasm",
}
REMEDY = "give its folder or .tgz of that version by export.web_runtime"


def runtime_files(given: str | None, cache: Path) -> dict[str, bytes]:
    """The files by their names in the page.

    Args:
        given: Folder of the unpacked npm package, or the package itself (``npm pack
            onnxruntime-web@VERSION``); None fetches it once.
        cache: Folder where it is kept.

    Raises:
        UserError: If it cannot be had, or is not the one that is expected.
    """
    if given is None:
        content = _kept(cache / f"{NAME}-{VERSION}.tgz")
    elif (path := Path(given).expanduser()).is_dir():
        return _from_folder(path)
    elif not path.is_file():
        raise UserError(f"export.web_runtime={given} does not exist; {REMEDY}.")
    else:
        content = _checked(path.read_bytes(), f"File {path}")
    with tarfile.open(fileobj=io.BytesIO(content)) as package:
        members = {name: package.extractfile(f"package/dist/{name}") for name in FILES}
        return {FILES[name]: each.read() for name, each in members.items() if each is not None}


def _from_folder(folder: Path) -> dict[str, bytes]:
    """The files of a folder that is the package, its ``dist``, or what ``npm install`` made."""
    places = (".", "dist", "package/dist", f"node_modules/{NAME}/dist")
    for place in (folder / each for each in places):
        if all((place / name).is_file() for name in FILES):
            return {kept: (place / name).read_bytes() for name, kept in FILES.items()}
    raise UserError(
        f"export.web_runtime={folder} lacks {' or '.join(FILES)} of {NAME} {VERSION}; {REMEDY}."
    )


def _kept(archive: Path) -> bytes:
    """The package in the cache, fetched if it is not there whole."""
    if archive.is_file() and _digest(content := archive.read_bytes()) == INTEGRITY:
        return content
    content = _checked(_fetch(), "The package that the npm registry gave")
    write_bytes(archive, content)
    return content


def _checked(content: bytes, what: str) -> bytes:
    """Refuse a package that is not bit for bit the one that was tested."""
    if _digest(content) != INTEGRITY:
        raise UserError(f"{what} is not {NAME} {VERSION} (its SHA-512 differs); {REMEDY}.")
    return content


def _digest(content: bytes) -> str:
    return f"sha512-{base64.b64encode(hashlib.sha512(content).digest()).decode()}"


def _fetch() -> bytes:
    """The package by npm, which knows the registry of this machine, else from its address."""
    npm = shutil.which("npm")
    if npm is not None and (content := _by_npm(npm)) is not None:
        return content
    registry = os.environ.get("NPM_CONFIG_REGISTRY", REGISTRY).rstrip("/")
    address = f"{registry}/{NAME}/-/{NAME}-{VERSION}.tgz"
    try:
        with urllib.request.urlopen(address, timeout=TIMEOUT) as answer:
            return bytes(answer.read())
    except (OSError, ValueError) as error:  # no network, no such address
        raise UserError(
            f"The page needs {NAME} {VERSION}, which {address} does not give ({error}); {REMEDY}."
        ) from error


def _by_npm(npm: str) -> bytes | None:
    with tempfile.TemporaryDirectory() as folder:
        order = [npm, "pack", f"{NAME}@{VERSION}", "--pack-destination", folder, *RETRIES]
        try:
            subprocess.run(order, capture_output=True, check=True, timeout=TIMEOUT)
        except (OSError, subprocess.SubprocessError):
            return None
        found = list(Path(folder).glob("*.tgz"))
        return found[0].read_bytes() if found else None
