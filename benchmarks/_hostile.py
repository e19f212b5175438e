"""Files that claim, hold or are more than a reader should take, and the commands that read them."""

import os
import pickle
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks._classifiers import make_classifier
from benchmarks.mutations import LONG, RATE, SMALL
from tex_lightning.classifier.checkpoint import lightning_state

Write = Callable[[Path], object]
MARK = "harmed"  # file that would show that code of a file has run
SPARSE = 1 << 30  # bytes that need no disk
TEXT = 200 << 20  # bytes of one line
SIDE = 40_000  # pixels


class Harm:
    """Makes a file when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.mark),)


def sparse(path: Path) -> None:
    with path.open("wb") as stream:
        stream.truncate(SPARSE)


def long_line(path: Path) -> None:
    with path.open("wb") as stream:
        for _ in range(TEXT >> 20):
            stream.write(b"0.25,-1." * (1 << 17))


def claiming_wav(size: int, rate: int = RATE, channels: int = 1) -> Write:
    """A WAV file whose header claims so many bytes."""

    def write(path: Path) -> None:
        form = struct.pack("<IHHIIHH", 16, 1, channels, rate, rate * 2 % 2**32, 2, 16)
        head = b"RIFF" + struct.pack("<I", 0xFFFFFFFF) + b"WAVEfmt " + form + b"data"
        path.write_bytes(head + struct.pack("<I", size) + (LONG[0] * 3e4).astype("<i2").tobytes())

    return write


def claiming_npy(shape: str, kind: str = "<f8") -> Write:
    def write(path: Path) -> None:
        head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
        path.write_bytes(b"\x93NUMPY\x01\x00" + struct.pack("<H", len(head)) + head + bytes(800))

    return write


def pickled_npy(path: Path) -> None:
    np.save(path, np.array([Harm(path.with_name(MARK))], object), allow_pickle=True)


def bomb_png(path: Path) -> None:
    """Zeros, of which a thousand are a byte."""

    def chunk(name: bytes, content: bytes) -> bytes:
        body = name + content
        return struct.pack(">I", len(content)) + body + struct.pack(">I", zlib.crc32(body))

    packer = zlib.compressobj(9)
    row = bytes(1 + SIDE // 8)
    rows = b"".join(packer.compress(row) for _ in range(SIDE)) + packer.flush()
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", SIDE, SIDE, 1, 0, 0, 0, 0))
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + head + chunk(b"IDAT", rows) + chunk(b"IEND", b""))


def pickled_checkpoint(path: Path) -> None:
    path.write_bytes(pickle.dumps(Harm(path.with_name(MARK))))


def pickled_in_archive(path: Path) -> None:
    torch.save({"hyper_parameters": Harm(path.with_name(MARK))}, path)


def wide_network(path: Path) -> None:
    """A card that asks for a network of hundreds of GiB."""
    card, state = network("model=haptic", *SMALL)
    card["senses"]["haptic"]["width"] = 99.0
    torch.save({"hyper_parameters": {"card": card}, "state_dict": state}, path)


def network(*overrides: str) -> tuple[dict[str, Any], dict[str, torch.Tensor]]:
    classifier = make_classifier(*overrides, classes=3)
    return classifier.card.to_dict(), lightning_state(classifier)


def zip_bomb(member: str, start: bytes = b"") -> Write:
    """An archive of a few MiB that holds 4 GiB of zeros."""

    def write(path: Path) -> None:
        archive = zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1)
        with archive, archive.open(member, "w", force_zip64=True) as stream:
            stream.write(start)
            for _ in range(4096):
                stream.write(bytes(1 << 20))

    return write


def text(content: str) -> Write:
    return lambda path: path.write_text(content)


def nothing(path: Path) -> None:
    """No file at all."""


TRACES: dict[str, Write] = {
    "sparse.csv": sparse,
    "line.csv": long_line,
    "2gb.wav": claiming_wav(0x7FFE0000),
    "channels.wav": claiming_wav(100, channels=65_535),
    "claims.npy": claiming_npy("(1000000000000,)"),
    "item.npy": claiming_npy("(3,)", "<U500000000"),
    "pickled.npy": pickled_npy,
    "pipe.wav": os.mkfifo,
    "zero.wav": lambda path: path.symlink_to("/dev/zero"),
    "loop.npy": lambda path: path.symlink_to(path),
    "x" * 300 + ".wav": nothing,
}
PHOTOS: dict[str, Write] = {
    "bomb.png": bomb_png,
    "pipe.png": os.mkfifo,
}
CHECKPOINTS: dict[str, Write] = {
    "pickled.ckpt": pickled_checkpoint,
    "archive.ckpt": pickled_in_archive,
    "wide.ckpt": wide_network,
    "bomb.ckpt": zip_bomb("archive/data.pkl"),
    "pipe.ckpt": os.mkfifo,
}
WEIGHTS: dict[str, Write] = {
    "bomb.npz": zip_bomb("conv1.weight.npy", b"\x93NUMPY\x01\x00"),
    "pickled.pth": pickled_checkpoint,
    "bomb.pth": zip_bomb("archive/data.pkl"),
    "pipe.npz": os.mkfifo,
}


def commands(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Write the files and give each command by name; all have to end with status 2."""
    for files in (TRACES, PHOTOS, CHECKPOINTS, WEIGHTS):
        for name, write in files.items():
            write(folder / name)
    for kind, more in (("haptic", SMALL), ("visual", ())):
        card, state = network(f"model={kind}", *more)
        content = {"hyper_parameters": {"card": card}, "state_dict": state}
        torch.save(content, folder / f"{kind}.ckpt")
    np.save(folder / "a.npy", LONG)
    (folder / "folder.wav").mkdir()
    yield from _predictions(folder)
    yield from _trainings(folder)


def _predictions(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Files, many at once, and checkpoints."""
    own = ["task=predict", f"checkpoint={folder}/haptic.ckpt"]
    for sense, kind, files in (("haptic", "haptic", TRACES), ("image", "visual", PHOTOS)):
        given = ",".join(f'"{folder / name}"' for name in files)
        whole = ["task=predict", f"checkpoint={folder / kind}.ckpt", f"{sense}=[{given}]"]
        yield f"predict, {sense}", whole
    yield "folder.wav", [*own, f"haptic={folder}/folder.wav"]
    for name in CHECKPOINTS:
        yield name, ["task=predict", f"checkpoint={folder / name}", f"haptic={folder}/a.npy"]


def _trainings(folder: Path) -> Iterator[tuple[str, list[str]]]:
    """Weights of trunks."""
    for name in WEIGHTS:
        trunk = "efficientnet_lite0" if name.endswith(".pth") else "alexnet"
        plain = ["model.visual.width=1", "model.visual.norm=none", "data=synthetic"]
        yield name, ["model=visual", f"trunk={trunk}", f"weights={folder / name}", *plain]
