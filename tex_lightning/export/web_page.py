"""A trained network as a page for the browser: a folder of files for any file server."""

import json
from collections.abc import Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any

from tex_lightning.files import write_bytes

RUNTIME = "onnxruntime"  # its folder in the page's
CARD = "model.json"


def write_page(
    out: Path, network: bytes, metadata: Mapping[str, Any], runtime: Mapping[str, bytes]
) -> int:
    """Write the page.

    Args:
        out: Its folder.
        network: The ONNX file, every input of which is given by the page: ONNX Runtime Web takes
            none that has a default.
        metadata: What the file says of itself.
        runtime: Files of ONNX Runtime Web by name.

    Returns:
        How many bytes the folder's files have together.

    Raises:
        UserError: If it cannot be written.
    """
    sources = files("tex_lightning.export").joinpath("web")
    content = {each.name: each.read_bytes() for each in sources.iterdir() if each.is_file()}
    content |= {f"{RUNTIME}/{name}": each for name, each in runtime.items()}
    content[f"{RUNTIME}/LICENSE.txt"] = content.pop("onnxruntime_license.txt")
    content |= {f"{metadata['kind']}.onnx": network, CARD: json.dumps(metadata).encode()}
    for name, each in content.items():
        write_bytes(out / name, each)
    return sum(map(len, content.values()))
