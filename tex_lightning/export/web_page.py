"""A trained network as a page for the browser: a folder of files for any file server.

The page runs on ONNX Runtime Web, from the npm registry or from a machine's own copy.
"""

import base64
import hashlib
import io
import json
import os
import tarfile
import urllib.request
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from tex_lightning.core.files import write_bytes
from tex_lightning.errors import UserError
from tex_lightning_runtime.files import expanded, require_file

RUNTIME = "onnxruntime"  # its folder in the page's
CARD = "model.json"


def page_files(metadata: Mapping[str, Any], runtime: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return the files of the page around the network ``KIND.onnx``, by their paths in its folder.

    Every input of that file has to be given: ONNX Runtime Web takes none that has a default.
    """
    sources = files("tex_lightning.export").joinpath("web")
    content = {
        f"script/{file.name}" if file.name.endswith(".js") else file.name: file.read_bytes()
        for file in sources.iterdir()
    }
    content |= {f"{RUNTIME}/{name}": part for name, part in runtime.items()}
    content[f"{RUNTIME}/LICENSE.txt"] = content.pop("onnxruntime_license.txt")
    content[CARD] = json.dumps(metadata).encode()
    return content


NAME, VERSION = "onnxruntime-web", "1.30.0"
INTEGRITY = (  # as the registry gives it: npm view onnxruntime-web@VERSION dist.integrity
    "sha512-q0y+JrrtukXSzsBWEMccVfqX25LRmosXHF+CaRJmg8pZClzcV7svNc4rKY3jL02Vb7QmRMDs1SigqR4CXAfKYQ=="
)
REGISTRY = "https://registry.npmjs.org"
TIMEOUT = 300  # s, for 33 MB
# By their names in the package. File servers know .js, and not all of them .mjs.
FILES = {
    "ort.wasm.bundle.min.mjs": "ort.wasm.bundle.min.js",
    "ort-wasm-simd-threaded.wasm": "ort-wasm-simd-threaded.wasm",
}
REMEDY = f"give that package (npm pack {NAME}@{VERSION}) by export.web_runtime"


def runtime_files(path: str | None, cache: Path) -> dict[str, bytes]:
    """Return the files of ONNX Runtime Web by their names in the page.

    Args:
        path: The npm package; None fetches it once from the registry, or from that of
            ``NPM_CONFIG_REGISTRY``.
        cache: Folder where it is kept.

    Raises:
        UserError: If it cannot be had, or is not bit for bit the one that was tested.
    """
    archive = cache / f"{NAME}-{VERSION}.tgz" if path is None else expanded(path)
    if path is not None:
        require_file(archive)
    content = archive.read_bytes() if archive.is_file() else b""
    if path is None and _digest(content) != INTEGRITY:
        content = _fetch()
    if _digest(content) != INTEGRITY:
        raise UserError(f"{archive.name} is not {NAME} {VERSION} (SHA-512 differs); {REMEDY}.")
    if path is None:
        write_bytes(archive, content)
    with tarfile.open(fileobj=io.BytesIO(content)) as package:
        members = {name: package.extractfile(f"package/dist/{name}") for name in FILES}
        return {FILES[name]: file.read() for name, file in members.items() if file is not None}


def _digest(content: bytes) -> str:
    return f"sha512-{base64.b64encode(hashlib.sha512(content).digest()).decode()}"


def _fetch() -> bytes:
    registry = os.environ.get("NPM_CONFIG_REGISTRY", REGISTRY).rstrip("/")
    address = f"{registry}/{NAME}/-/{NAME}-{VERSION}.tgz"
    try:
        with urllib.request.urlopen(address, timeout=TIMEOUT) as answer:
            return bytes(answer.read())
    except (OSError, ValueError) as error:  # no network, no such address
        raise UserError(
            f"The page needs {NAME} {VERSION}, which {address} does not give ({error}); {REMEDY}."
        ) from error
