"""Small valid files in every format that is read, with the reader of each."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import soundfile
import torch
from PIL import Image
from torch import nn

from benchmarks._classifiers import configured, make_classifier
from tex_lightning.baselines.classifier import BaselineClassifier, load_classifier
from tex_lightning.classifier import SurfaceClassifier, lightning_state
from tex_lightning.config import CONF
from tex_lightning.config.composition import compose_config
from tex_lightning.config.search import use_config_dir
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.data.recordings import read_manifest
from tex_lightning.export.onnx_file import make_onnx, write_onnx
from tex_lightning.export.tracing import trace
from tex_lightning.launch import as_mistake
from tex_lightning.networks.blocks import Window
from tex_lightning.networks.trunks import Trunk
from tex_lightning.networks.weights import load_trunk_weights
from tex_lightning.perturbations.table import read_severities
from tex_lightning.recording.sources import Float32Parser, TextParser
from tex_lightning.runfolder import find_checkpoint
from tex_lightning.runs.workspace import configured_card
from tex_lightning_runtime import Runtime

Array = np.ndarray[Any, Any]

RATE = 10_000
AXES = (0.3 * np.random.default_rng(0).standard_normal((3, 1500))).clip(-1, 1).round(4)
PIXELS = np.random.default_rng(1).integers(0, 256, (48, 40, 3), np.uint8)
SIGNAL, PHOTO = SignalDecoder(), PhotoDecoder()
SMALL = ("model.haptic.width=0.05", "model.haptic.norm=none", "model.haptic.skip_impact=false")
LONG = np.tile(AXES, 14)  # enough for a fragment


@dataclass(frozen=True)
class Format:
    """One kind of file.

    Attributes:
        name: Of the file that is damaged.
        write: Writes it whole, with what has to lie beside it.
        read: Reads it and gives every number that came of it.
        text: Whether it consists of words.
        says: What names the mistake where the file cannot.
        weight: How many times as many versions of it are tried.
    """

    name: str
    write: Callable[[Path], object]
    read: Callable[[Path], list[Array]]
    text: bool = False
    says: tuple[str, ...] = ()
    weight: float = 1.0


def _sound(path: Path, subtype: str = "PCM_16", axes: int = 1) -> None:
    soundfile.write(path, AXES[:axes].T, RATE, subtype=subtype)


def _table(path: Path, head: str, mark: str, timed: bool = False, axes: int = 1) -> None:
    columns = [np.arange(AXES.shape[1]) / RATE, *AXES] if timed else AXES[:axes]
    lines = [mark.join(f"{value:.9g}" for value in row) for row in np.stack(columns).T.tolist()]
    path.write_text("\n".join([head, *lines] if head else lines), encoding="utf-8")


def _xml(path: Path) -> None:
    axes = "".join(
        f"<Accel{axis}>{' '.join(map(str, values))}</Accel{axis}>"
        for axis, values in zip("XYZ", AXES[:, :300].tolist(), strict=True)
    )
    path.write_text(f'<?xml version="1.0"?><R><SampleRate>{RATE}</SampleRate>{axes}</R>')


def _photo(path: Path, **options: Any) -> None:  # noqa: ANN401
    exif = Image.Exif()
    exif[0x0112] = 6  # orientation
    Image.fromarray(PIXELS).save(path, exif=exif, **options)


def _manifest(path: Path) -> None:
    for name in ("a", "b"):
        _table(path.with_name(f"{name}.csv"), "", ",")
    lines = [f"{name},haptic,{name}.csv,0,10000,0-0.5,50" for name in "ab"]
    path.write_text("\n".join(["label,modality,path,group,rate,part,speed", *lines]))


def _beside(path: Path, text: str) -> None:
    """A statement about ``trace.npy``, which lies beside it."""
    np.save(path.with_name("trace.npy"), AXES)
    path.write_text(text)


def _severities(path: Path) -> None:
    path.write_text(
        "haptic:\n  hum:\n    function: tex_lightning.perturbations.traces.mains_hum\n"
        "    unit: dB\n    levels: [0, 1, 2, 3, 4, 5]\n"
    )


def _run(path: Path) -> None:
    (path.parent / "checkpoints").mkdir(exist_ok=True)
    for kind in ("haptic", "fusion"):
        (path.parent / "checkpoints" / f"{kind}.ckpt").touch()
    path.write_text(json.dumps({"task": "fit", "model.senses": ["haptic", "visual"]}, indent=1))


def _configuration(path: Path) -> None:
    path.parent.mkdir(exist_ok=True)
    path.write_text((CONF / "data" / "folder.yaml").read_text(encoding="utf-8"))


@cache
def network() -> SurfaceClassifier:
    """A small HapticNet of random weights."""
    return make_classifier("model=haptic", *SMALL, classes=3)


def _checkpoint(path: Path) -> None:
    card = network().card.to_dict()
    content = {"hyper_parameters": {"card": card}, "state_dict": lightning_state(network())}
    torch.save(content, path)


def _baseline(path: Path) -> None:
    recipe = configured("model=mfcc_nb")
    classifier = BaselineClassifier(configured_card(recipe, ["haptic"], ["a", "b"]))
    classifier.baseline.fit([AXES[0], AXES[1], AXES[2]], np.array([0, 1, 1]), seed=0)
    classifier.save(path, 1.0)


class SmallTrunk(Trunk):
    """Two convolutions with every layout of weight files."""

    norms = ("none",)
    geometry = (Window(3, 2), Window(3, 2))
    fc1_kernel = 7
    patch = 32
    final = ("layers.2",)
    layouts = {  # noqa: RUF012
        "caffe": {"conv1": "layers.0", "conv2": "layers.2"},
        "torchvision": {"features.0": "layers.0", "features.3": "layers.2"},
    }

    def build(self) -> nn.Sequential:
        """Return the layers."""
        self.out_channels = 4
        return nn.Sequential(nn.Conv2d(3, 4, 3, 2), nn.ReLU(), nn.Conv2d(4, 4, 3, 2), nn.ReLU())


class LiteTrunk(SmallTrunk):
    """The same of EfficientNet-Lite's names."""

    layouts = {  # noqa: RUF012
        "efficientnet": {"_conv_stem": "layers.0", "_blocks.0._depthwise_conv": "layers.2"}
    }


def _layers(names: dict[str, str]) -> dict[str, Array]:
    """Weights and biases by the names of a layout."""
    torch.manual_seed(0)
    state, found = SmallTrunk(width=1, norm="none").state_dict(), {}
    for theirs, ours in names.items():
        for kind in ("weight", "bias"):
            found[f"{theirs}.{kind}"] = state[f"{ours}.{kind}"].numpy()
    return found


CAFFE = SmallTrunk.layouts["caffe"]


def _pth(path: Path, trunk: type[Trunk]) -> None:
    (names,) = [each for layout, each in trunk.layouts.items() if layout != "caffe"]
    content = {name: torch.from_numpy(array) for name, array in _layers(names).items()}
    for norm in ("_bn0", "_blocks.0._bn1") if trunk is LiteTrunk else ():
        content |= {f"{norm}.{key}": torch.ones(4) for key in ("weight", "bias")}
        content |= {f"{norm}.running_{key}": torch.ones(4) for key in ("mean", "var")}
    torch.save(content, path)


def _caffemodel(path: Path) -> None:
    """A network in protobuf's wire format."""
    arrays, content = _layers(CAFFE), b""
    for name in CAFFE:
        blobs = b""
        for kind in ("weight", "bias"):
            array = arrays[f"{name}.{kind}"]
            shape = _field(1, b"".join(map(_varint, array.shape)))
            blobs += _field(7, _field(7, shape) + _field(5, array.astype("<f4").tobytes()))
        content += _field(100, _field(1, name.encode()) + blobs)
    path.write_bytes(content)


def _field(number: int, content: bytes) -> bytes:
    return _varint(number << 3 | 2) + _varint(len(content)) + content


def _varint(value: int) -> bytes:
    low, rest = value & 127, value >> 7
    return bytes([low | 128]) + _varint(rest) if rest else bytes([low])


def _mat(path: Path, compressed: bool) -> None:
    arrays, layers = _layers(CAFFE), []
    for name in CAFFE:
        weights = np.empty(2, object)
        weights[0] = arrays[f"{name}.weight"].transpose(2, 3, 1, 0)
        weights[1] = arrays[f"{name}.bias"]
        layers.append({"name": name, "type": "conv", "weights": weights})
    mean = {"normalization": {"averageImage": np.full((2, 2, 3), 120.0)}}
    content = {"layers": np.array(layers, object), "meta": mean}
    scipy.io.savemat(path, content, do_compression=compressed)


def _onnx(path: Path) -> None:
    classifier = make_classifier("model=haptic", *SMALL, classes=2)
    write_onnx(make_onnx(classifier, trace(classifier)), path)


def read_signal(path: Path) -> list[Array]:
    samples = SIGNAL.decode(path)[0]
    assert samples.dtype == np.float32
    assert len(samples) in (1, 3)
    return [samples]


def read_pixels(path: Path) -> list[Array]:
    pixels = PHOTO.decode(path)[0]
    assert pixels.dtype == np.uint8
    assert pixels.ndim == 3
    assert pixels.shape[2] == 3
    return [pixels]


def read_rows(path: Path) -> list[Array]:
    rows = read_manifest(path)
    assert all(row.path.is_file() and row.label and row.group_key for row in rows)
    return [np.array([row.sampling_rate or 1.0 for row in rows])]


def classify(path: Path) -> list[Array]:
    vote = load_classifier(path).classify(haptic=torch.from_numpy(LONG).float())
    return [vote.probabilities.numpy()]


def read_weights(path: Path, kind: type[Trunk]) -> list[Array]:
    trunk = kind(width=1, norm="none")
    load_trunk_weights(trunk, path)
    return [tensor.numpy() for tensor in trunk.state_dict().values()]


def run_exported(path: Path) -> list[Array]:
    found = Runtime(path, threads=1).predict(haptic=LONG)
    return [np.array([found["probability"], found["confidence"]], np.float64)]


def feed(path: Path, kind: Callable[[str, str, int], Any]) -> list[Array]:
    parser, content = kind(str(path), "record.haptic", 3), path.read_bytes()
    pieces = [content[start : start + 512] for start in range(0, len(content), 512)]
    samples = [parser.feed(piece) for piece in pieces]
    parser.end()
    return [*(each for each in samples if each.size), np.ones(1)]  # a piece may end no sample


def compose_own(path: Path) -> list[Array]:
    use_config_dir([f"--config-dir={path.parents[1]}"])
    given = ["data=own", f"data.root={path.parent}"]
    try:
        compose_config(CONF, given)
    except Exception as error:
        mistake = as_mistake(error, given, began=False)
        if mistake is None:
            raise
        raise mistake from error
    return [np.ones(1)]


def find_own(path: Path) -> list[Array]:
    assert find_checkpoint(path.parent).is_file()
    return [np.ones(1)]


def severities(path: Path) -> list[Array]:
    return [np.array(each.levels, np.float64) for each in read_severities(str(path)).values()]


HEAD = "time,x,y,z"
CAFFE_READ = partial(read_weights, kind=SmallTrunk)
LITE_READ = partial(read_weights, kind=LiteTrunk)

FORMATS: dict[str, Format] = {
    "wav": Format("a.wav", _sound, read_signal),
    "wav float, 3 axes": Format("a.wav", partial(_sound, subtype="FLOAT", axes=3), read_signal),
    "flac": Format("a.flac", _sound, read_signal),
    "npy": Format("a.npy", lambda path: np.save(path, AXES), read_signal),
    "txt": Format("a.txt", partial(_table, head="", mark=","), read_signal, text=True),
    "csv with times": Format(
        "a.csv", partial(_table, head=HEAD, mark=",", timed=True), read_signal, text=True
    ),
    "xml": Format("a.xml", _xml, read_signal, text=True),
    "jpeg": Format("a.jpg", _photo, read_pixels),
    "png": Format("a.png", _photo, read_pixels),
    "tiff": Format("a.tif", partial(_photo, compression="tiff_lzw"), read_pixels),
    "tiff, jpeg": Format("a.tif", partial(_photo, compression="jpeg"), read_pixels),
    "webp": Format("a.webp", _photo, read_pixels),
    "bmp": Format("a.bmp", lambda path: Image.fromarray(PIXELS).save(path), read_pixels),
    "manifest": Format("m.csv", _manifest, read_rows, text=True, weight=2),
    "sidecar": Format(
        "trace.json",
        partial(_beside, text='{"rate": 10000, "tool": "steel"}'),
        lambda path: read_signal(path.with_suffix(".npy")),
        text=True,
    ),
    "rates.csv": Format(
        "rates.csv",
        partial(_beside, text="path,rate\ntrace.npy,10000\n"),
        lambda path: read_signal(path.with_name("trace.npy")),
        text=True,
    ),
    "checkpoint": Format("a.ckpt", _checkpoint, classify),
    "checkpoint of a baseline": Format("b.ckpt", _baseline, classify),
    "caffemodel": Format("a.caffemodel", _caffemodel, CAFFE_READ),
    "MatConvNet": Format("a.mat", partial(_mat, compressed=True), CAFFE_READ),
    "MatConvNet, plain": Format("a.mat", partial(_mat, compressed=False), CAFFE_READ),
    "npz": Format("a.npz", lambda path: np.savez(path, **_layers(CAFFE)), CAFFE_READ),
    "pth": Format("a.pth", partial(_pth, trunk=SmallTrunk), CAFFE_READ),
    "pth of EfficientNet": Format("a.pth", partial(_pth, trunk=LiteTrunk), LITE_READ),
    "exported onnx": Format("a.onnx", _onnx, run_exported),
    "severities": Format("s.yaml", _severities, severities, text=True),
    "settings.json": Format("settings.json", _run, find_own, text=True),
    "configuration": Format(
        "data/own.yaml", _configuration, compose_own, text=True,
        says=("too long", "data/own", "nested"), weight=0.5,
    ),
    "sensor, text": Format(
        "a.bin", partial(_table, head="#", mark=" ", axes=3), partial(feed, kind=TextParser),
        text=True,
    ),
    "sensor, float32": Format(
        "a.bin",
        lambda path: path.write_bytes(AXES.T.astype("<f4").tobytes()),
        partial(feed, kind=Float32Parser),
    ),
}  # fmt: skip
