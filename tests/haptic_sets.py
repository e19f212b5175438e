"""Published data sets as they are read, and small folders in the layouts of today's haptic ones."""

from itertools import product
from pathlib import Path

import numpy as np
from conftest import make_photo, make_trace
from omegaconf import OmegaConf
from PIL import Image

from tex_lightning.config.composition import compose_config
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings

RATE = 6000
SURFACES = ("0", "7", "12")
STROKES = list(product((0, 135), (20, 60), (500, 1000), (0, 1)))
Array = np.ndarray


def read(*overrides: str, modalities: list[str] | None = None) -> Recordings:
    """The table of a data set as the command line configures it."""
    return read_recordings(OmegaConf.to_object(compose_config(overrides).data), modalities)


def tone(kind: int, rate: int, seconds: float, seed: int, axes: int = 1) -> Array:
    """Noise (axes, samples) with a tone of its own for each class."""
    rng = np.random.default_rng([kind, seed])
    time = np.arange(int(rate * seconds)) / rate
    wave = 0.3 * np.sin(2 * np.pi * (200 + 350 * kind) * time + rng.uniform(0, 6))
    return wave + 0.03 * rng.standard_normal((axes, len(time)))


def stamps(count: int, seed: int) -> Array:
    """Uneven times in s: jitter of microseconds, and two samples lost."""
    rng = np.random.default_rng(seed)
    times = (0.001 + np.arange(count + 2) / RATE) + rng.uniform(-35e-6, 35e-6, count + 2)
    return np.delete(times, [count // 2, count // 2 + 1])


def write_csv(path: Path, names: str, columns: Array) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [",".join(f"{value:.9g}" for value in row) for row in columns.T.tolist()]
    path.write_text("\n".join([names, *lines]), encoding="utf-8")


def write_cluster(root: Path, seconds: float) -> Path:
    """Surfaces with the accelerations and forces of strokes."""
    for (kind, surface), (seed, stroke) in product(enumerate(SURFACES), enumerate(STROKES)):
        name = "_".join(map(str, (surface, *stroke)))
        for sensor, names in (("accel", "time,X,Y,Z"), ("force", "time,force")):
            axes = tone(kind, RATE, seconds, seed, names.count(","))
            times = stamps(axes.shape[1], seed)
            file = root / "sensor_data" / sensor / surface / f"{name}.csv"
            write_csv(file, names, np.vstack([times, axes]))
    return root


def write_tum(root: Path, classes: int, seconds: float, side: int) -> Path:
    """Ten traces and photos of each class, whose names are ``S1`` and so on."""
    accel, images = root / "Training" / "Accel", root / "Training" / "Images"
    accel.mkdir(parents=True)
    images.mkdir()
    for kind in range(classes):
        for number in range(10):
            np.savetxt(accel / f"S{kind + 1}_query{number}.txt", make_trace(kind, number, seconds))
            photo = Image.fromarray(make_photo(kind, number, side))
            photo.save(images / f"IMG_{5529 + 10 * kind + number}.JPG")
    return root


def touch(root: Path, *names: str) -> Path:
    """Write files without recordings in them, for readers that look at names alone."""
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    return root
