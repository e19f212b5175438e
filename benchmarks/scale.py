"""A data set of the paper's size: 69 classes, 10 traces of 20 s and 10 photos of 8 megapixels each.

``python -m benchmarks scale``, or smaller ``python -m benchmarks.scale --classes 6``. The files, in
the layout of the TUM database (text traces), are made for this: of each class one trace and one
photo are rendered, the others are that trace rotated in time and that photo mirrored, rotated and
brightened. They and the cache are written to the folder for temporary files (some 8 GB) and
removed. Three steps, each a process of its own:

- decoding: the store fills itself, and a bare loop decodes the same files with the same libraries
  (NumPy, Pillow, Kornia) in one process for each core, and writes nothing; both take turns.
- training: steps of HapticNet, VisualNet and FusionNet beside a bare PyTorch loop, as in
  ``benchmarks.training``.
- run: ``model=fusion`` with all three networks on one fold, few steps each, to the last figure.

A whole fold in full: ``python -m tex_lightning model=fusion data=tum data.root=DIR``.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from kornia.geometry.transform import rescale
from PIL import Image

from benchmarks._classifiers import configured
from benchmarks._process import run_watched
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recording, Recordings, write_manifest
from tex_lightning.data.store import Store, cache_root
from tex_lightning.studies.dataset import check_networks
from tex_lightning.synthetic.dataset import SyntheticSpec, photograph, record
from tex_lightning.synthetic.materials import make_materials
from tex_lightning.synthetic.specimen import Specimen

CLASSES, PER_CLASS, SECONDS = 69, 10, 20.0
SIZE = (3264, 2448)  # pixels of a photo
TURNS = 10  # of the store and the bare loop
BUDGET = (
    *(f"model.{kind}.fit.epochs=3" for kind in ("haptic", "visual", "fusion")),
    *(f"model.{kind}.fit.steps_per_epoch=10" for kind in ("haptic", "visual", "fusion")),
)


def measure(classes: int = CLASSES, recordings: int = PER_CLASS) -> dict[str, Any]:
    """By step seconds and peak memory, and the ratios to the bare loops."""
    with tempfile.TemporaryDirectory() as folder:
        data = write_files(classes, recordings, Path(folder) / "data")
        keys = [*data, f"data.cache_dir={folder}/cache"]
        decoding = _step("benchmarks.scale", "--decode", *keys)
        decoded = json.loads(decoding.pop("output"))
        training = _step("benchmarks.training", *keys, *BUDGET)
        networks = json.loads(training.pop("output"))["networks"]
        run = _step("tex_lightning", "model=fusion", *keys, *BUDGET, f"hydra.run.dir={folder}/run")
        run.pop("output")
        results = json.loads((Path(folder) / "run" / "results.json").read_text("utf-8"))
    return {
        "classes": classes,
        "recordings": 2 * classes * recordings,
        "decoding": {**decoding, **decoded},
        "training": {
            **training,
            **{f"{name}_to_bare_ratio": each["ratio"] for name, each in networks.items()},
        },
        "run": {
            **run,
            **{f"{name}_fit_s": each["fit_seconds"] for name, each in results["networks"].items()},
        },
    }


def _step(module: str, *arguments: str) -> dict[str, Any]:
    found = run_watched([sys.executable, "-m", module, *arguments])
    return found


def write_files(classes: int, recordings: int, root: Path) -> list[str]:
    """Write the data set; return the keys that read it."""
    spec = SyntheticSpec(classes, seconds=SECONDS, photo_width=SIZE[0] // 2,
                         photo_height=SIZE[1] // 2)  # fmt: skip
    accel, images = root / "Training" / "Accel", root / "Training" / "Images"
    accel.mkdir(parents=True)
    images.mkdir()
    materials = make_materials(classes, spec.seed)

    def write_class(index: int) -> list[Recording]:
        specimen, name = Specimen(materials[index]), materials[index].name
        lines = [f"{value:.7g}" for value in record(spec, specimen, index, 0)[0].tolist()]
        photo = cv2.resize(photograph(spec, specimen, index, 0), SIZE)
        rows = []
        for number in range(recordings):
            begin = number * len(lines) // recordings
            trace = accel / f"{name}_query{number}.txt"
            trace.write_text("\n".join([*lines[begin:], *lines[:begin]]) + "\n")
            changed = np.roll(photo[:: 1 - 2 * (number % 2)], number * 97, axis=1)
            changed = cv2.convertScaleAbs(changed, alpha=1 - 0.03 * number)
            image = images / f"IMG_{5529 + index * recordings + number}.JPG"
            cv2.imwrite(str(image), changed)
            rows += [Recording(name, "haptic", trace, number, 10_000.0),
                     Recording(name, "image", image, number)]  # fmt: skip
        return rows

    with ThreadPoolExecutor(2) as pool:
        rows = [row for each in pool.map(write_class, range(classes)) for row in each]
    if recordings == PER_CLASS:
        return ["data=tum", f"data.root={root}"]
    manifest = root / "manifest.csv"  # the layout holds ten of each class
    write_manifest(Recordings(tuple(rows)), manifest)
    return [
        "data=manifest",
        f"data.manifest={manifest}",
        f"data.folds={recordings}",
        "data.sampling_rate=10000",
    ]


def decode(keys: Sequence[str]) -> dict[str, Any]:
    """Fill the store and run the bare loop over the same files, a part of them at a time."""
    config = configured("model=fusion", *keys)
    decoders = {each.modality: each.decoder for each in check_networks(config)}
    store = Store(cache_root(config.data.cache_dir), decoders)
    rows = list(read_recordings(config.data, list(decoders)))
    spent = dict.fromkeys(("store", "bare"), 0.0)
    cores = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(cores, get_context("spawn"), torch.set_num_threads, (1,)) as pool:
        list(pool.map(_decode_bare, [rows[0].path] * 2 * cores))  # they import for seconds
        for turn in range(TURNS):
            part = rows[turn::TURNS]
            ways = {
                "store": lambda part=part: store.fill(part),
                "bare": lambda part=part: list(pool.map(_decode_bare, [row.path for row in part])),
            }
            for name in sorted(ways, reverse=bool(turn % 2)):
                begin = time.perf_counter()
                ways[name]()
                spent[name] += time.perf_counter() - begin
    return {
        "store_files_per_s": len(rows) / spent["store"],
        "bare_files_per_s": len(rows) / spent["bare"],
        "rate_to_bare_ratio": spent["bare"] / spent["store"],
    }


def _decode_bare(path: Path) -> None:
    if path.suffix == ".txt":
        np.loadtxt(path, np.float32)
        return
    pixels = torch.from_numpy(np.array(Image.open(path).convert("RGB")))
    small = rescale(pixels.permute(2, 0, 1)[None].float(), 0.5, antialias=False)
    small[0].add_(0.5).byte().permute(1, 2, 0).contiguous().numpy()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--classes", type=int, default=CLASSES)
    parser.add_argument("--recordings", type=int, default=PER_CLASS)
    parser.add_argument("--decode", nargs="+", help=argparse.SUPPRESS)
    given = vars(parser.parse_args())
    keys = given.pop("decode")
    print(json.dumps(measure(**given) if keys is None else decode(keys), indent=1))


if __name__ == "__main__":
    main()
