"""Small data in the real layouts, and the command line as a function."""

import copy
import functools
import gc
import hashlib
import os
import shutil
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
import torch
from composing import compose_once
from drawing import draw_once
from filelock import FileLock
from hydra._internal.hydra import Hydra
from hypothesis import settings
from omegaconf import OmegaConf
from PIL import Image
from second_device import chosen, register

from tex_lightning.__main__ import main
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.checkpoint import lightning_state
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import CONF
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.instantiation import named_classes
from tex_lightning.core.devices import pick_device
from tex_lightning.networks.trunks import TRUNKS
from tex_lightning.networks.visualnet import VisualNet

# A job that a shell put in the background ignores Ctrl-C, and so do all processes it starts
signal.signal(signal.SIGINT, signal.default_int_handler)

if pick_device("auto").type == "cpu":
    register()  # before the first gradient in this process, which would leave the device out

# The same examples every time, and no deadline: machines that run tests are often busy
settings.register_profile("few", derandomize=True, deadline=None, max_examples=10)
settings.register_profile("many", settings.get_profile("few"), max_examples=100)
settings.load_profile("few")

RATE = 10_000
CLASSES = ("alpha", "beta", "gamma")
SHORT_WINDOWS = {  # of band proportions: those that take a moment
    "model.haptic.features.windows": [0.032, 0.256],
    "model.haptic.features.bands_per_octave": [6, 6],
}
FEW = "experiment=few/haptic", *(f"{key}={value}" for key, value in SHORT_WINDOWS.items())
SHARED = Path(__file__).resolve().parents[2] / "shared"


def pytest_configure(config) -> None:
    """The slow suite tries many examples of each property.

    The package's configuration files are read once a process, also by what modules compose.
    """
    if config.option.markexpr == "slow":
        settings.load_profile("many")
    patch = pytest.MonkeyPatch()
    config.add_cleanup(patch.undo)
    compose_once(patch)


def pytest_collection_finish() -> None:
    """Garbage is not looked for among all modules again and again."""
    gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items) -> None:
    """The slow suite has the properties in it, too."""
    if config.option.markexpr == "slow":
        for item in items:
            if item.get_closest_marker("hypothesis"):
                item.add_marker("slow")


@pytest.fixture(scope="session")
def shared() -> Path:
    """Real recordings beside the checkout; the test is skipped where there are none."""
    if not (SHARED / "data").is_dir():
        pytest.skip("no real recordings beside the checkout")
    return SHARED


@pytest.fixture(scope="session")
def common(tmp_path_factory) -> Path:
    """A folder that all processes of this run of the tests share."""
    base = tmp_path_factory.getbasetemp()
    folder = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "common"
    folder.mkdir(exist_ok=True)
    return folder


def make_once(folder: Path, make: Callable[[Path], object]) -> Path:
    """A folder that the first process that asks for it fills."""
    with FileLock(f"{folder}.lock"):
        if not folder.exists():
            try:
                make(folder)
            except BaseException:
                shutil.rmtree(folder, ignore_errors=True)
                raise
    return folder


@pytest.fixture(scope="session")
def cache(common) -> Path:
    """One cache for all tests, so that synthetic surfaces are rendered once."""
    (common / "cache").mkdir(exist_ok=True)
    return common / "cache"


@pytest.fixture(autouse=True)
def only_the_packages_own_classes(monkeypatch) -> None:
    """What one test trusts, the next does not."""
    monkeypatch.setattr("tex_lightning.config.instantiation._TRUSTED", set())


def trunk_node(name: str) -> dict[str, object]:
    """A published trunk as a card names it."""
    cls = TRUNKS[name]
    return {"_target_": f"{cls.__module__}.{cls.__name__}"}


def visualnet(
    classes: int,
    trunk: str = "alexnet_caffe",
    *,
    width: float = 1.0,
    norm: str = "batch",
    **options: object,
) -> VisualNet:
    """A VisualNet on a published trunk."""
    return VisualNet(classes, TRUNKS[trunk](width=width, norm=norm), **options)


def ramp(frames: int, start: int) -> torch.Tensor:
    """A spectrogram whose columns are numbered."""
    return (start + torch.arange(frames).float()).repeat(3, 1)


def make_trace(kind: int, recording: int, seconds: float = 2.4) -> np.ndarray:
    """A tone of its own for each class in noise, in [-1, 1]."""
    rng = np.random.default_rng([kind, recording])
    time = np.arange(int(seconds * RATE)) / RATE
    tone = 0.3 * np.sin(2 * np.pi * (150 + 250 * kind) * time + rng.uniform(0, 6))
    return (tone + 0.03 * rng.standard_normal(len(time))).astype(np.float32)


def make_photo(kind: int, recording: int, side: int = 240) -> np.ndarray:
    """Stripes of its own width for each class, at any angle, under noise."""
    rng = np.random.default_rng([kind, recording, 1])
    y, x = np.mgrid[:side, :side]
    angle = rng.uniform(0, np.pi)
    wave = np.sin((x * np.cos(angle) + y * np.sin(angle)) * 2 * np.pi / (6 * 2**kind))
    grey = 128 + 60 * wave + 8 * rng.standard_normal((side, side))
    return np.repeat(grey.clip(0, 255).astype(np.uint8)[..., None], 3, axis=2)


def own_arrays() -> dict[str, object]:
    """Names as the documentation has them: recordings (12, 1, samples), labels and sessions."""
    traces = [make_trace(kind, recording) for kind in range(3) for recording in range(4)]
    labels, sessions = np.repeat(CLASSES, 4), np.tile([0, 0, 1, 1], 3)
    return {"X": np.stack(traces)[:, None], "y": labels, "session": sessions}


@pytest.fixture(scope="session")
def surfaces(common) -> Path:
    """ROOT/CLASS/{haptic,image}: three classes, ten recordings each, easily told apart."""
    return make_once(common / "surfaces", write_surfaces)


def write_surfaces(root: Path) -> None:
    for kind, label in enumerate(CLASSES):
        for modality in ("haptic", "image"):
            (root / label / modality).mkdir(parents=True)
        for recording in range(10):
            wav = root / label / "haptic" / f"{label}_{recording}.wav"
            soundfile.write(wav, make_trace(kind, recording), RATE, subtype="FLOAT")
            photo = Image.fromarray(make_photo(kind, recording))
            photo.save(root / label / "image" / f"{label}_{recording}.png")


@dataclass(frozen=True)
class Outcome:
    status: int
    out: str
    err: str


def run_main(patch: pytest.MonkeyPatch, *arguments: object) -> int:
    """The exit status of a command, without things that take time and are tested elsewhere.

    Hydra does not compose once more to learn a mode that nothing but ``-m`` and some experiments
    ask for, and figures of a kind are drawn once.
    """
    given = ["tex_lightning", *map(str, arguments)]
    patch.setattr(sys, "argv", given)
    with patch.context() as alone:
        if not any(item.startswith(("-m", "experiment=")) for item in given):
            alone.setattr(Hydra, "get_mode", lambda *_, **__: None)
        draw_once(alone)
        return main()


@pytest.fixture
def cli(cache, monkeypatch, tmp_path_factory, capfd) -> Callable[..., Outcome]:
    """Run the command line in this process, with the tests' cache and one thread.

    In a folder of its own, so that no path among the arguments leads into the checkout.
    """
    monkeypatch.chdir(tmp_path_factory.mktemp("cwd"))

    def run(*arguments: object) -> Outcome:
        common = [f"data.cache_dir={cache}"]
        capfd.readouterr()
        try:
            status = run_main(monkeypatch, *arguments, *common)
        except SystemExit as stop:
            status = int(stop.code or 0)
        captured = capfd.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run


@pytest.fixture(scope="session")
def run_once(cache, common) -> Callable[..., Path]:
    """The run folder of a command, which runs once for all tests that give the same arguments.

    Nobody writes into it: a test that goes on in a run copies it first.
    """
    runs = common / "runs"
    runs.mkdir(exist_ok=True)

    def run(*arguments: object) -> Path:
        digest = hashlib.sha256("\0".join(map(str, arguments)).encode()).hexdigest()[:16]

        def make(directory: Path) -> None:
            folders = [f"data.cache_dir={cache}", f"hydra.run.dir={directory}"]
            with pytest.MonkeyPatch.context() as patch:
                assert run_main(patch, *arguments, *folders) == 0

        return make_once(runs / digest, make)

    return run


@pytest.fixture(scope="session")
def tiny(surfaces) -> list[str]:
    """The arguments of a small run on the surfaces."""
    return [
        "data=folder", f"data.root={surfaces}", "data.half_scale=false", "debug=tiny",
        "trainer.threads=1",
    ]  # fmt: skip


@pytest.fixture(scope="session")
def fused(run_once, tiny) -> Path:
    """HapticNet and VisualNet, trained and fused."""
    return run_once("model=fusion", *tiny)


@pytest.fixture(scope="session")
def crossvalidated(run_once, tiny) -> Path:
    """HapticNet on two folds of ten."""
    return run_once("task=crossval", "model=haptic", "crossval.only=[0,3]", *tiny)


@pytest.fixture(scope="session")
def frontier_run(run_once, tiny) -> Path:
    """A network run in two ways and a baseline, on two folds."""
    only = "hapticnet_w0.5,hapticnet_w0.5_sequential,mfcc_nb"
    folds = ("crossval.only=[0,5]", "data.classes=3")
    return run_once("task=frontier", f"frontier.only=[{only}]", *folds, *tiny)


@pytest.fixture(scope="session")
def swept(run_once, tiny) -> Path:
    """A sweep over two folds."""
    folds = ("data.test_fold=0,1", "data.val_fold=null")
    return run_once("-m", "hydra.sweep.dir=${hydra.run.dir}", "model=mfcc_nb", *folds, *tiny)


def configured_classes() -> set[str]:
    """Every class that the package's configuration puts into a card."""
    named = set()
    for file in [path for group in ("sense", "model", "trunk") for path in CONF.glob(f"{group}/*")]:
        content = OmegaConf.to_container(OmegaConf.load(file))
        named |= {*named_classes({key: each for key, each in content.items() if key != "fusion"})}
    return named


@functools.cache
def sense_node(sense: str) -> dict[str, Any]:
    """What a card says of a branch by default."""
    return read_config(compose_config()).model.sense(sense).node


def make_card(
    *senses: str,
    classes: Sequence[str] = CLASSES,
    level: str = "fc2",
    pairs: int = 50,
    **changes: Any,
) -> Card:
    """The card of a classifier.

    Args:
        *senses: Its branches; photos are not halved.
        classes: Their names.
        level: That is fused.
        pairs: That are voted over.
        **changes: Keys of a branch, for each that has them: ``width=0.1``, ``axes="trace"``,
            ``sampling_rate=2000.0``, ``half_scale=True``.
    """
    branches = {sense: copy.deepcopy(sense_node(sense)) for sense in senses}
    for node in branches.values():
        if "half_scale" in node["decode"]:
            node["decode"]["half_scale"] = False
        for part in (node, node["decode"]):
            part |= {key: value for key, value in changes.items() if key in part}
    return Card(
        classes=list(classes),
        senses=branches,
        decision={"pairs": pairs, "seed": 0, "rule": "vote", "unknown": None},
        fusion={"level": level} if len(senses) > 1 else {},
    )


@pytest.fixture(scope="session")
def bands(run_once, surfaces) -> Path:
    """A run folder of the rule on proportions of bands, fitted to the surfaces in a moment."""
    features = "model.haptic.features"  # without the longest window, whose graph takes a while
    windows = f"{features}.windows=[0.032,0.256,0.93]", f"{features}.bands_per_octave=[6,6,12]"
    return run_once("experiment=few/haptic", *windows, "data=folder", f"data.root={surfaces}")


@pytest.fixture(scope="session")
def naive_bayes(run_once, tiny) -> Path:
    """A run folder of a baseline."""
    return run_once("model=mfcc_nb", *tiny)


@pytest.fixture
def second_device() -> Iterator[torch.device]:
    """A device beside the CPU, which ``trainer.accelerator=auto`` takes in these tests."""
    with chosen() as device:
        yield device


@pytest.fixture(scope="session", autouse=True)
def no_pretrained_default() -> Iterator[None]:
    """Let VisualNet on folders begin with random weights, whatever is installed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tex_lightning.data.derived_settings.weights_are_installed", lambda: False)
        yield


def save_checkpoint(card: Card, path: Path) -> Path:
    """A checkpoint of random weights."""
    torch.manual_seed(0)
    return save_classifier(SurfaceClassifier(card), path)


def save_classifier(classifier: SurfaceClassifier, path: Path, **changes: Any) -> Path:
    """A checkpoint of a classifier; ``changes`` replace what is in it."""
    parameters = {"card": classifier.card.to_dict()}
    content = {"hyper_parameters": parameters, "state_dict": lightning_state(classifier)}
    torch.save(content | changes, path)
    return path


@pytest.fixture(scope="session")
def untrained(common) -> Path:
    """A run folder with a small FusionNet and its parts, of random weights."""
    return make_once(common / "untrained", write_untrained)


@pytest.fixture(scope="session")
def random_fusion(common) -> Path:
    """Checkpoint of a small FusionNet of random weights, with what training leaves behind."""
    from random_fusion import write_random_fusion  # which takes what is here

    return make_once(common / "random_fusion", write_random_fusion) / "fusion.ckpt"


@pytest.fixture(scope="session")
def exported(random_fusion, run_once) -> tuple[Path, Path]:
    """The same checkpoint, and its exported file."""
    run = run_once("task=export", f"checkpoint={random_fusion}", "export.check=3")
    return random_fusion, run / "fusion.onnx"


def write_untrained(folder: Path) -> None:
    (folder / "checkpoints").mkdir(parents=True)
    for senses in (("haptic",), ("visual",), ("haptic", "visual")):
        card = make_card(*senses, classes=["a", "b", "c"], width=0.1)
        save_checkpoint(card, folder / "checkpoints" / f"{card.kind}.ckpt")
    (folder / "settings.json").write_text('{"model.senses": ["haptic", "visual"]}')
