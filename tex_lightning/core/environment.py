"""The environment in which a figure was measured: versions, commit, processor and device."""

import os
import platform
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch

from tex_lightning import __version__

LIBRARIES = ("torch", "lightning", "kornia", "hydra-core", "numpy", "scipy")


def environment(device: torch.device, precision: str | None = None) -> dict[str, Any]:
    """Return the environment in which a figure was measured.

    Args:
        device: That computed. An NVIDIA GPU is described further.
        precision: That of the trainings (``trainer.precision``); None tells none.
    """
    cuda = device.type == "cuda"
    name = torch.cuda.get_device_name(device) if cuda else device.type
    return {
        "versions": {
            "tex_lightning": __version__,
            "python": platform.python_version(),
            **{library: version(library) for library in LIBRARIES},
        },
        "commit": _commit(Path(__file__).parents[2]),
        "cpu": _cpu_name(),
        "cores": os.cpu_count(),
        "device": name,
        "threads": torch.get_num_threads(),
        **({"cuda": {**_cuda_versions(), "precision": precision}} if cuda else {}),
    }


def _cuda_versions() -> dict[str, Any]:
    """Return what the results of an NVIDIA GPU depend on, beside its name."""
    return {
        "cuda": torch.version.cuda,
        "cudnn": torch.backends.cudnn.version(),  # type: ignore[no-untyped-call]  # no annotation
        "driver": _output("nvidia-smi", "--query-gpu=driver_version", "--format=csv,noheader"),
        "tf32": torch.backends.cuda.matmul.allow_tf32,
    }


def _commit(root: Path) -> str | None:
    """Return the commit of a checkout, ``-dirty`` if files were changed; None elsewhere."""
    if not (root / ".git").exists():  # installed, perhaps below a checkout of something else
        return None
    return _output("git", "-C", str(root), "describe", "--always", "--dirty", "--exclude=*")


def _output(*command: str) -> str | None:
    """Return the first line that a command prints; None where it fails, or prints nothing."""
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)
    except (OSError, subprocess.SubprocessError):
        return None
    return next(iter(done.stdout.splitlines()), None)


def _cpu_name() -> str:
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.is_file() else []
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, "") or platform.processor() or platform.machine()
