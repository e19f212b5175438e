"""A trained network as a page for the browser: a folder of files for any file server."""

import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from tex_lightning.files import write_bytes

RUNTIME = "onnxruntime"  # its folder in the page's
CARD = "model.json"


def write_page(out: Path, metadata: Mapping[str, Any], runtime: Mapping[str, bytes]) -> int:
    """Write the page around the network ``KIND.onnx``.

    Every input of that file has to be given: ONNX Runtime Web takes none that has a default.

    Args:
        out: Its folder.
        metadata: What the file says of itself.
        runtime: Files of ONNX Runtime Web by name.

    Returns:
        How many bytes were written.

    Raises:
        UserError: If it cannot be written.
    """
    sources = files("tex_lightning.export").joinpath("web")
    content = {_place(each.name): each.read_bytes() for each in sources.iterdir()}
    content |= {f"{RUNTIME}/{name}": each for name, each in runtime.items()}
    content[f"{RUNTIME}/LICENSE.txt"] = content.pop("onnxruntime_license.txt")
    content[CARD] = json.dumps(metadata).encode()
    for name, each in content.items():
        write_bytes(out / name, each)
    return sum(map(len, content.values()))


def _place(name: str) -> str:
    """The path of a source in the page's folder."""
    return f"script/{name}" if name.endswith(".js") else name
