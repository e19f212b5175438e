"""A classifier as a program of torch.export: one file that PyTorch runs without this package."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.export.check import Array, Runner
from tex_lightning.export.metadata import KEY, metadata
from tex_lightning.export.tracing import Traced, quiet

NOTE = f"{KEY}.json"  # the metadata, among the extra files of a program


def write_program(traced: Traced, classifier: SurfaceClassifier, path: Path) -> None:
    """Write a program with its metadata, and without the folders of this machine."""
    for node in traced.program.graph.nodes:
        node.meta.pop("stack_trace", None)
    with quiet(), path.open("wb") as stream:
        note = json.dumps(metadata(classifier))
        torch.export.save(traced.program, stream, extra_files={NOTE: note})


def program_runner(path: Path) -> Runner:
    """Return a function that runs a program from its file."""
    with quiet(), path.open("rb") as stream:
        return _runner(torch.export.load(stream).module())


def _runner(function: Callable[..., Any]) -> Runner:
    @torch.inference_mode()
    def run(inputs: Mapping[str, Array]) -> dict[str, Array]:
        given = {name: torch.from_numpy(np.asarray(each)) for name, each in inputs.items()}
        outputs: dict[str, Tensor] = function(**given)
        return {name: each.numpy() for name, each in outputs.items()}

    return run
