"""What the commands of the documentation name: recordings, photos, weights, data sets, sensors.

A page runs in a folder of its own. Placeholders such as ``DIR``, ``RUN`` and ``A.wav`` are files
and folders of that name in it, and ``../shared`` has small stand-ins for the real recordings.
"""

import base64
import gzip
import hashlib
import io
import shutil
import tarfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import soundfile
import torch
from conftest import RATE, make_photo, make_trace
from PIL import Image

from tex_lightning.data.recordings import natural_key
from tex_lightning.export.web_page import FILES
from tex_lightning.networks.trunks import TRUNKS

CLASSES = ("A", "B", "C", "D", "E", "F")
FEW = CLASSES[:3]  # of the measured sets: their sweeps are long enough
KINDS = (*CLASSES, "G", "H")
SENSES = ("haptic", "image", "sound")
SOUND_RATE = 44_100
SPEEDS = (30, 60, 80, 90)


def write_surfaces(
    root: Path, classes: Sequence[str], *senses: str, recordings: int = 10, side: int = 240
) -> Path:
    """``root/CLASS/SENSE/NAME_00`` and on, a tone and stripes of its own for each class."""
    for label in classes:
        kind = KINDS.index(label)
        for sense in senses:
            (root / label / sense).mkdir(parents=True)
        for number in range(recordings):
            for sense in senses:
                _write(root / label / sense / f"{label}_{number:02d}", sense, kind, number, side)
    return root


def _write(stem: Path, sense: str, kind: int, number: int, side: int = 240) -> None:
    if sense == "image":
        Image.fromarray(make_photo(kind, number, side)).save(stem.with_suffix(".jpg"))
        return
    trace = make_trace(kind, number)
    if sense == "sound":
        count = len(trace) * SOUND_RATE // RATE
        trace = np.interp(np.arange(count) * RATE / SOUND_RATE, np.arange(len(trace)), trace)
    rate = SOUND_RATE if sense == "sound" else RATE
    soundfile.write(stem.with_suffix(".wav"), trace, rate, subtype="FLOAT")


def write_sample(folder: Path) -> None:
    """``A.wav`` and ``B.jpg``, which no network was trained on."""
    _write(folder / "A", "haptic", 0, 20)
    _write(folder / "B", "image", 0, 20, 2 * 224)


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


def write_shared(root: Path) -> Path:
    """Stand-ins for ``shared``, where measured figures have their recordings from."""
    data = root / "data"
    write_surfaces(data / "lmt16", FEW, "haptic")
    write_surfaces(data / "lmt16_sound", FEW, "sound")
    (data / "fingertip10").symlink_to(data / "lmt16")
    write_surfaces(data / "paired", FEW, "haptic", "image")
    write_manifest(data / "surfaces10.csv", data / "paired", "haptic", "image")
    write_surfaces(data / "all", CLASSES, *SENSES, side=2 * 224)  # they are halved
    return root


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


def enter_page(folder: Path, world: Path, run: Path | None) -> None:
    """Put what most pages name into the folder of one; ``RUN`` unless it makes its own."""
    folder.mkdir()
    if run is not None:
        shutil.copytree(run, folder / "RUN")
    for name in ("DIR", "DATA"):
        (folder / name).symlink_to(world / "data" / "all")
    (folder / "NEW").symlink_to(world / "new")
    write_sample(folder)
    write_manifest(folder / "THREE.csv", world / "data" / "all", *SENSES)
    write_manifest(folder / "FILE", world / "data" / "all", "haptic", "image")
