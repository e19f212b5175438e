"""What the commands of the documentation name: recordings, photos, weights, data sets, sensors.

A page runs in a folder of its own. Placeholders such as ``DIR``, ``RUN`` and ``A.wav`` are files
and folders of that name in it.
"""

import base64
import gzip
import hashlib
import io
import re
import shutil
import tarfile
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import soundfile
import torch
from conftest import RATE, make_photo, make_trace
from haptic_sets import write_tum
from PIL import Image

from tex_lightning.export.web_page import FILES, NAME, VERSION
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning_runtime.files import natural_key

KINDS = "ABCDEFGH"
WEIGHTS = {"ALEXNET.npz": "alexnet_caffe", "VGG_M.npz": "vgg_m"}
SOUND_RATE = 44_100
SPEEDS = (30, 60, 80, 90)


def write_surfaces(root: Path, classes: str, *senses: str, recordings: int = 10) -> None:
    """``root/CLASS/SENSE/NAME_00`` and on, a tone and stripes of its own for each class."""
    for label in classes:
        kind = KINDS.index(label)
        for sense in senses:
            (root / label / sense).mkdir(parents=True)
        for number in range(recordings):
            for sense in senses:
                _write(root / label / sense / f"{label}_{number:02d}", sense, kind, number)


def _write(stem: Path, sense: str, kind: int, number: int) -> None:
    if sense == "image":  # it is halved
        Image.fromarray(make_photo(kind, number, 2 * 224)).save(stem.with_suffix(".jpg"))
        return
    trace = make_trace(kind, number)
    if sense == "sound":
        count = len(trace) * SOUND_RATE // RATE
        trace = np.interp(np.arange(count) * RATE / SOUND_RATE, np.arange(len(trace)), trace)
    rate = SOUND_RATE if sense == "sound" else RATE
    soundfile.write(stem.with_suffix(".wav"), trace, rate, subtype="FLOAT")


def write_manifest(path: Path, surfaces: Path, *senses: str) -> None:
    """A manifest of ``surfaces``, with speeds of traces and lights of photos."""
    lines = ["label,modality,path,group,speed,light"]
    for file in sorted(surfaces.glob("*/*/*"), key=lambda each: natural_key(str(each))):
        sense, group = file.parent.name, int(file.stem.split("_")[1])
        if sense in senses:
            speed = SPEEDS[group % 4] if sense != "image" else ""
            light = ("lamp", "sun")[group % 2] if sense == "image" else ""
            label = file.parents[1].name
            lines.append(f"{label},{sense},{file.resolve()},{group},{speed},{light}")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def write_weights(path: Path, trunk: str) -> Path:
    """Random weights of a trunk as a file of Caffe's names."""
    torch.manual_seed(0)
    network = TRUNKS[trunk](width=1.0, norm="lrn")
    state = network.state_dict()
    names = [
        (f"{theirs}.{kind}", f"{ours}.{kind}")
        for theirs, ours in network.layouts["caffe"].items()
        for kind in ("weight", "bias")
    ]
    np.savez(path, **{theirs: state[ours].numpy() for theirs, ours in names})
    return path


def write_web_runtime(path: Path) -> str:
    """A small package in the place of ONNX Runtime Web; returns its digest."""
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w") as archive:
        for name in FILES:
            entry = tarfile.TarInfo(f"package/dist/{name}")
            entry.size = len(name)
            archive.addfile(entry, io.BytesIO(name.encode()))
    path.write_bytes(gzip.compress(packed.getvalue(), mtime=0))  # the same bytes every time
    return f"sha512-{base64.b64encode(hashlib.sha512(path.read_bytes()).digest()).decode()}"


def write_joined(folder: Path) -> None:
    """Write two recordings in one file, in each of three forms."""
    rows, labels = np.random.default_rng(0).standard_normal((2, 3, 500)), ["oak", "felt"]
    np.save(folder / "X.npy", rows)
    np.save(folder / "y.npy", labels)
    tables = [pd.DataFrame(row.T, columns=[*"xyz"]) for row in rows]
    for number, (table, label) in enumerate(zip(tables, labels, strict=True)):
        table["surface"], table["series_id"] = label, number
    pd.concat(tables).to_csv(folder / "all.csv", index=False)
    with h5py.File(folder / "all.h5", "w") as file:
        for row, label in zip(rows, labels, strict=True):
            file[f"{label}/1/acc"] = row


def lay_out(folder: Path, page: Path, world: Path, run: Path) -> None:
    """Put what a page names into its folder: recordings, weights, a ``RUN`` that it does not make.

    Args:
        folder: Empty.
        page: The page.
        world: Has surfaces in ``all`` and ``new``.
        run: A finished run.
    """
    text = page.read_text(encoding="utf-8")
    if not re.search(r"hydra\.(run|sweep)\.dir=RUN\b", text):
        shutil.copytree(run, folder / "RUN")
    for name in ("DIR", "DATA"):
        (folder / name).symlink_to(world / "all")
    (folder / "NEW").symlink_to(world / "new")
    _write(folder / "A", "haptic", 0, 20)  # which no network was trained on
    _write(folder / "B", "image", 0, 20)
    _write(folder / "C", "haptic", 1, 20)
    _write(folder / "D", "image", 1, 20)
    write_manifest(folder / "FILE", world / "all", "haptic", "image")
    for file, trunk in WEIGHTS.items():
        if file in text:
            write_weights(folder / f"{trunk}.npz", trunk)
    if "data.root=TUM" in text:
        write_tum(folder / "TUM", classes=3, seconds=4, side=480)
    if page.name == "data.md":
        write_joined(folder)
        for label in "AB":
            (folder / "STROKES" / label).mkdir(parents=True)
            _write(folder / "STROKES" / label / "ann_1", "haptic", 0, 0)
    if page.name == "deploy.md":
        write_web_runtime(folder / f"{NAME}-{VERSION}.tgz")
