"""What the commands of the documentation name: recordings, photos, weights, data sets, sensors.

A page runs in a folder of its own. Placeholders such as ``DIR``, ``RUN`` and ``A.wav`` are files
and folders of that name in it, and ``../shared`` has small stand-ins for the real recordings.
"""

import base64
import gzip
import hashlib
import io
import shutil
import socket
import tarfile
import threading
from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import soundfile
import torch
from conftest import RATE, make_photo, make_trace
from haptic_sets import write_cluster
from PIL import Image

from tex_lightning.data.recordings import natural_key
from tex_lightning.export.web_page import FILES
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning.synthetic import SyntheticSpec, write_tum

CLASSES = ("A", "B", "C", "D", "E", "F")
FEW = CLASSES[:3]  # of the measured sets: their sweeps are long enough
KINDS = (*CLASSES, "G", "H", "oak")
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


def write_lmt108(root: Path) -> Path:
    """Traces of three axes, photos and taps of two classes, as that data set names them."""
    scans = root / "AccelScansComponents"
    for kind, label in enumerate(("G1Mesh", "G2Brick")):
        for number in range(1, 11):
            names = [
                (scans / "Movement", f"{label}_Movement_{axis}_train{number}") for axis in "XYZ"
            ]
            names.append((scans / "Tapping", f"{label}_Tapping_train{number}"))
            for axis, (folder, name) in enumerate(names):
                (folder / "Training").mkdir(parents=True, exist_ok=True)
                values = make_trace(kind, 10 * number + axis).round(3).tolist()
                (folder / "Training" / f"{name}.txt").write_text("\n".join(map(str, values)))
            photos = root / "ImageScans" / "NoFlash" / "Training"
            photos.mkdir(parents=True, exist_ok=True)
            photo = Image.fromarray(make_photo(kind, number, 480))  # it is halved
            photo.save(photos / f"{label}_Image_{number}_train{number}.jpg")
    return root


def write_published(root: Path) -> Path:
    """The layouts of LMT-108 and of the Cluster Haptic Texture Dataset in one folder."""
    write_lmt108(root)
    strokes = product((0,), (20, 30, 40, 50, 60), (500,), (0, 1))
    return write_cluster(root, 2.4, "accel", "force", "images", strokes=list(strokes))


def write_tum_set(root: Path) -> Path:
    """The layout of the TUM data set."""
    write_tum(SyntheticSpec(classes=3, seconds=4.0, photo_width=640, photo_height=480), root)
    return root


def write_strokes(path: Path) -> Path:
    """Raw samples of a sensor: ten strokes of 1.4 s with silence between."""
    silence = 1e-4 * np.random.default_rng(0).standard_normal(8_000)
    strokes = [np.concatenate([silence, make_trace(0, number, 1.4)]) for number in range(10)]
    np.concatenate([*strokes, silence]).astype("<f4").tofile(path)
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


def serve_samples() -> str:
    """Six seconds of samples to whoever connects; gives ``HOST:PORT``."""
    server = socket.create_server(("127.0.0.1", 0))

    def send() -> None:
        connection, _ = server.accept()
        with server, connection:
            connection.sendall(make_trace(0, 0, 6.0).astype("<f4").tobytes())
            connection.recv(1)  # until the reader has gone

    threading.Thread(target=send, daemon=True).start()
    return f"127.0.0.1:{server.getsockname()[1]}"


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
