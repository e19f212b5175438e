"""What the runtime distribution costs beside the whole package: disk, start, memory, latency.

``python -m benchmarks runtime``

``runtime/`` is installed into an empty virtual environment, as ``docs/deploy.md`` says. Programs
that classify one sample and end run there and here, interleaved; the first one of each is not
counted, as it compiles Python's files. Latencies from file to label are taken in this process, also
interleaved, with as many threads on both sides. The networks have random weights.
``BENCHMARK_RUNTIME=haptic,fusion`` measures those of these names only.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
import torch
from PIL import Image

import tex_lightning as tl
from benchmarks._classifiers import make_classifier
from tex_lightning.classifier.checkpoint import lightning_state
from tex_lightning.config import CONF
from tex_lightning.errors import UserError
from tex_lightning.export.onnx_file import make_onnx, onnx_bytes
from tex_lightning.studies.timing import interleaved

RUNTIME = CONF.parent / "runtime"
NETWORKS = {
    "haptic": ("model=haptic",),
    "fusion": ("model=fusion",),
    "fusion_efficientnet": ("model=fusion_efficientnet", "weights=null"),
}
STARTS, BUDGET_S = 5, 20.0
PEAK = "print([s.split()[1] for s in open('/proc/self/status') if s.startswith('VmHWM')][0])"
CODES = {
    "runtime": "from tex_lightning_runtime import Runtime as load",
    "package": "from tex_lightning import load",
}


def measure() -> dict[str, Any]:
    """Installed MB; by network seconds to the first label, peak MiB, latencies and ratios."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        python = install(folder / "venv")
        files = list((folder / "venv").rglob("site-packages/**/*"))
        size = sum(file.stat().st_size for file in files if file.is_file())
        chosen = os.environ.get("BENCHMARK_RUNTIME", ",".join(NETWORKS)).split(",")
        figures = {
            kind: compared(folder, python, kind, write(folder / kind, NETWORKS[kind]))
            for kind in chosen
        }
    return {"installed_mb": size / 1e6, "threads": torch.get_num_threads(), **figures}


def install(folder: Path) -> Path:
    """An environment that holds the runtime and what it needs; gives its Python."""
    pip = [sys.executable, "-m", "pip", "--python", str(folder / "bin" / "python"), "install", "-q"]
    try:
        subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
        compiled = {**os.environ, "PYTHONDONTWRITEBYTECODE": ""}
        subprocess.run([*pip, str(RUNTIME)], check=True, capture_output=True, env=compiled)
    except subprocess.CalledProcessError as error:
        raise UserError("The runtime cannot be installed here; is there a network?") from error
    return folder / "bin" / "python"


def write(folder: Path, overrides: tuple[str, ...]) -> dict[str, str]:
    """Checkpoint, exported file and recordings of one sample; gives the recordings."""
    folder.mkdir()
    classifier = make_classifier(*overrides)
    state = lightning_state(classifier)
    card = classifier.card.to_dict()
    torch.save({"hyper_parameters": {"card": card}, "state_dict": state}, folder / "a.ckpt")
    (folder / "a.onnx").write_bytes(onnx_bytes(make_onnx(classifier)))
    rng = np.random.default_rng(0)
    soundfile.write(folder / "a.wav", 0.1 * rng.standard_normal(48_000), 10_000)
    Image.fromarray(rng.integers(0, 256, (960, 1280, 3), np.uint8)).save(folder / "a.jpg")
    files = {"haptic": str(folder / "a.wav"), "image": str(folder / "a.jpg")}
    return {modality: files[modality] for modality in classifier.card.modalities}


def compared(folder: Path, python: Path, kind: str, given: dict[str, str]) -> dict[str, Any]:
    """Figures of one network."""
    onnx, checkpoint = str(folder / kind / "a.onnx"), str(folder / kind / "a.ckpt")
    words = [f"{modality}={file}" for modality, file in given.items()]
    quiet = [f"hydra.run.dir={folder / 'run'}"]
    commands = {
        "runtime": [str(python), "-m", "tex_lightning_runtime", onnx, *words],
        "package": [sys.executable, "-m", "tex_lightning", "task=predict",
                    f"checkpoint={checkpoint}", *words, *quiet],
    }  # fmt: skip
    starts = interleaved({name: partial(run, each) for name, each in commands.items()}, STARTS)
    peaks = {
        "runtime": peak([str(python)], CODES["runtime"], onnx, given),
        "package": peak([sys.executable], CODES["package"], checkpoint, given),
    }
    latencies = interleaved(predictors(onnx, checkpoint, given), 1000, 3, budget_s=BUDGET_S)
    figures: dict[str, Any] = {
        "onnx_mb": Path(onnx).stat().st_size / 1e6,
        "first_label_s": {name: each.median / 1000 for name, each in starts.items()},
        "peak_mib": peaks,
        "latency_ms": {name: each.median for name, each in latencies.items()},
        "latency_rounds": len(latencies["runtime"].calls),
    }
    for name in ("first_label_s", "peak_mib", "latency_ms"):
        figures[f"{name.rsplit('_', 1)[0]}_ratio"] = (
            figures[name]["runtime"] / figures[name]["package"]
        )
    return figures


def predictors(onnx: str, checkpoint: str, given: dict[str, str]) -> dict[str, Callable[[], Any]]:
    """Classify one sample, by the runtime and by the accelerated network of the package."""
    sys.path.insert(0, str(RUNTIME))
    from tex_lightning_runtime import Runtime

    files: dict[str, Any] = {**given}
    runtime = Runtime(onnx, threads=torch.get_num_threads())
    return {
        "runtime": partial(runtime.predict, **files),
        "package": partial(tl.load(checkpoint).predict, **files),
    }


def peak(python: list[str], load: str, model: str, given: dict[str, str]) -> float:
    """Largest resident set in MiB of a program that classifies one sample."""
    code = f"{load}\nload({model!r}).predict(**{given!r})\n{PEAK}"
    return int(run([*python, "-c", code]).split()[-1]) / 1024


def run(command: list[str]) -> str:
    """What a program prints; it may keep compiled files, as programs do."""
    changed = {"PYTHONDONTWRITEBYTECODE": "", "PYTHONPATH": str(CONF.parent)}
    finished = subprocess.run(
        command, check=True, capture_output=True, text=True, env={**os.environ, **changed}
    )
    return finished.stdout
