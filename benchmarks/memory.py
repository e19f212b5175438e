"""Peak memory of classifying one photo of 48 megapixels, above that of program and network.

Each network runs in a process of its own. It first classifies a small photo, so that libraries and
weights are in place; what the large one adds to the peak of the resident set is the figure. The
photo is read from its file as ``task=predict`` reads it, without being halved.
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from PIL import Image

from benchmarks._classifiers import make_classifier
from benchmarks.engine import DEFAULT
from tex_lightning.core.devices import keep_memory
from tex_lightning.data.decode import PhotoDecoder, decode_image
from tex_lightning.inference.engine import accelerate
from tex_lightning.networks.trunks import TRUNKS

SIZE = (8000, 6000)
COMPARED = "alexnet_caffe"  # also run on the photo as a whole, for its labels


def measure() -> dict[str, Any]:
    """Added peak in MiB for every trunk of VisualNet at width 1, in tiles."""
    with tempfile.TemporaryDirectory() as folder:
        photo = write_photo(Path(folder) / "photo.jpg", SIZE)
        figures = {trunk: in_process(photo, trunk, DEFAULT.tile) for trunk in TRUNKS}
        whole = in_process(photo, COMPARED, None)
    labels = {trunk: figure.pop("labels") for trunk, figure in figures.items()}
    return {
        **figures,
        "most_added_to_1_gib_ratio": max(f["added_mib"] for f in figures.values()) / 1024,
        "not_divided": {
            "trunk": COMPARED,
            "added_mib": whole["added_mib"],
            "seconds": whole["seconds"],
            "same_labels": whole["labels"] == labels[COMPARED],
        },
    }


def write_photo(path: Path, size: tuple[int, int]) -> Path:
    """A photo of that width and height with structure at several scales."""
    rng = np.random.default_rng(0)
    image = Image.new("RGB", size)
    for side in (8, 64, 1024):
        small = rng.integers(0, 256, (size[1] // side, size[0] // side, 3)).astype(np.uint8)
        layer = Image.fromarray(small).resize(size, Image.Resampling.BILINEAR)
        image = Image.blend(image, layer, 0.5)
    image.save(path, quality=90)
    return path


def in_process(photo: Path, trunk: str, tile: int | None) -> dict[str, Any]:
    """Run :func:`classify` in a fresh interpreter."""
    command = [sys.executable, "-m", "benchmarks.memory", str(photo), trunk, json.dumps(tile)]
    finished = subprocess.run(command, check=True, capture_output=True, text=True)
    figures: dict[str, Any] = json.loads(finished.stdout)
    return figures


def classify(photo: Path, trunk: str, tile: int | None) -> dict[str, Any]:
    """Added peak in MiB, seconds with decoding, and the fragments' labels as text."""
    cls = TRUNKS[trunk]
    plain = make_classifier(
        "model=visual",
        "model.visual.width=1",
        f"model.visual.norm={'lrn' if 'lrn' in cls.norms else 'batch'}",
        f"model.visual.trunk={{_target_: {cls.__module__}.{cls.__name__}}}",
    )
    classifier, decoder = accelerate(plain, replace(DEFAULT, tile=tile)), PhotoDecoder(False)
    classifier.classify(image=torch.zeros(400, 400, 3, dtype=torch.uint8))
    before, begin = peak(), time.perf_counter()
    vote = classifier.classify(image=torch.from_numpy(decode_image(photo, decoder)))
    labels = "".join(map(chr, (vote.fragments + ord("a")).tolist()))
    return {
        "before_mib": before,
        "added_mib": peak() - before,
        "seconds": time.perf_counter() - begin,
        "labels": labels,
    }


def peak() -> float:
    """Largest resident set of this process so far, in MiB."""
    status = Path("/proc/self/status")
    if status.is_file():  # what getrusage says on Linux may be the parent's, from before exec
        lines = status.read_text(encoding="utf-8").splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20


if __name__ == "__main__":
    path, name, most = sys.argv[1:]
    keep_memory()  # as every task does
    print(json.dumps(classify(Path(path), name, json.loads(most))))
