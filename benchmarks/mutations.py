"""Damaged files of every common format, given to the readers: accepted, refused, or wrong.

``python -m benchmarks mutations``. Small valid files are damaged in many ways (:mod:`._mutate`),
always in the same. Right is to give finite numbers or one sentence that names the file, without
warnings and prints of libraries (:mod:`._attempts`). Needs Linux, for the peaks of memory.
"""

import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
import torch
from PIL import Image

from benchmarks._attempts import ACCEPTED, Attempt, Tally, attempt
from benchmarks._classifiers import make_classifier
from benchmarks._mutate import mutated
from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.checkpoint import lightning_state
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.data.manifest import read_manifest
from tex_lightning.networks.trunks import published
from tex_lightning.networks.weights import load_trunk_weights

Array = np.ndarray[Any, Any]

COUNT = 48  # files of each format
RATE = 10_000
AXES = (0.3 * np.random.default_rng(0).standard_normal((3, 1500))).clip(-1, 1).round(4)
PIXELS = np.random.default_rng(1).integers(0, 256, (48, 40, 3), np.uint8)
SIGNAL, PHOTO = SignalDecoder(), PhotoDecoder()
SMALL = ("model.haptic.width=0.05", "model.haptic.norm=none", "model.haptic.skip_impact=false")
LONG = np.tile(AXES, 14)  # enough for a fragment


@dataclass(frozen=True)
class Format:
    """One kind of file: its name, who writes it whole and who reads it, and whether it is text."""

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], list[Array]]
    text: bool = False


def _sound(path: Path, subtype: str = "PCM_16", axes: int = 1) -> None:
    soundfile.write(path, AXES[:axes].T, RATE, subtype=subtype)


def _table(path: Path, head: str, mark: str, timed: bool = False, axes: int = 1) -> None:
    columns = [np.arange(AXES.shape[1]) / RATE, *AXES] if timed else AXES[:axes]
    lines = [mark.join(f"{value:.9g}" for value in row) for row in np.stack(columns).T.tolist()]
    path.write_text("\n".join([head, *lines] if head else lines), encoding="utf-8")


def _photo(path: Path, **options: Any) -> None:  # noqa: ANN401
    exif = Image.Exif()
    exif[0x0112] = 6  # orientation
    Image.fromarray(PIXELS).save(path, exif=exif, **options)


def _manifest(path: Path) -> None:
    for name in ("a", "b"):
        _table(path.with_name(f"{name}.csv"), "", ",")
    lines = [f"{name},haptic,{name}.csv,0,10000,0-0.5,50" for name in "ab"]
    path.write_text("\n".join(["label,modality,path,group,rate,part,speed", *lines]))


def save_network(path: Path) -> None:
    """A checkpoint of a small HapticNet of random weights."""
    classifier = make_classifier("model=haptic", *SMALL, classes=3)
    card = {"card": classifier.card.to_dict()}
    torch.save({"hyper_parameters": card, "state_dict": lightning_state(classifier)}, path)


def _weights(path: Path) -> None:
    trunk = published("tcnn")
    names, state = trunk.layouts["caffe"], trunk.state_dict()
    layers = [(*pair, kind) for pair in names.items() for kind in ("weight", "bias")]
    arrays = {f"{theirs}.{kind}": state[f"{ours}.{kind}"].numpy() for theirs, ours, kind in layers}
    np.savez(path, **arrays)


def read_signal(path: Path) -> list[Array]:
    return [SIGNAL.decode(path)[0]]


def read_pixels(path: Path) -> list[Array]:
    return [PHOTO.decode(path)[0]]


def read_rows(path: Path) -> list[Array]:
    return [np.array([row.sampling_rate or 1.0 for row in read_manifest(path)])]


def classify(path: Path) -> list[Array]:
    vote = load_classifier(path).classify(haptic=torch.from_numpy(LONG).float())
    return [vote.probabilities.numpy()]


def read_weights(path: Path) -> list[Array]:
    trunk = published("tcnn")
    load_trunk_weights(trunk, path)
    return [tensor.numpy() for tensor in trunk.state_dict().values()]


FORMATS: dict[str, Format] = {
    "wav": Format("a.wav", _sound, read_signal),
    "flac": Format("a.flac", _sound, read_signal),
    "npy": Format("a.npy", lambda path: np.save(path, AXES), read_signal),
    "txt": Format("a.txt", partial(_table, head="", mark=","), read_signal, text=True),
    "csv": Format("a.csv", partial(_table, head="time,x,y,z", mark=",", timed=True), read_signal,
                  text=True),
    "jpeg": Format("a.jpg", _photo, read_pixels),
    "png": Format("a.png", _photo, read_pixels),
    "tiff": Format("a.tif", partial(_photo, compression="tiff_lzw"), read_pixels),
    "webp": Format("a.webp", _photo, read_pixels),
    "manifest": Format("m.csv", _manifest, read_rows, text=True),
    "checkpoint": Format("a.ckpt", save_network, classify),
    "npz": Format("a.npz", _weights, read_weights),
}  # fmt: skip


def measure(count: str = str(COUNT)) -> dict[str, Any]:
    """Counts of each format and of all, with the worst time and memory."""
    tallies = {name: tally(name, int(count)) for name in FORMATS}
    wrong = sum(len(each.wrong) for each in tallies.values())
    return {"wrong": wrong, **{name: each.figures() for name, each in tallies.items()}}


def tally(name: str, count: int) -> Tally:
    """All damaged files of one format."""
    found = Tally()
    with tempfile.TemporaryDirectory() as folder:
        for way, each in attempts(name, count, Path(folder).resolve()):
            found.add(way, each)
    return found


def attempts(name: str, count: int, folder: Path) -> Iterator[tuple[str, Attempt]]:
    """Each damage by name and what came of it."""
    kind, path = FORMATS[name], folder / FORMATS[name].name
    kind.write(path)
    whole = attempt(lambda: kind.read(path), str(folder))
    if whole.outcome != ACCEPTED:
        raise RuntimeError(f"{name} is refused whole: {whole.why}")
    number = [*FORMATS].index(name)
    for way, content in mutated(path.read_bytes(), count, text=kind.text, number=number):
        path.write_bytes(content)
        yield way, attempt(lambda: kind.read(path), str(folder))
