"""Writing synthetic data sets to disk, in the layouts of real ones."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from tex_lightning.config.data import SyntheticConfig
from tex_lightning.config.keys import Key, walk
from tex_lightning.errors import UserError
from tex_lightning.features.dft321 import dft321
from tex_lightning.synthetic.camera import Light, render_photo
from tex_lightning.synthetic.materials import make_materials
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import slide_tool

RATE = 10_000  # Hz of traces
CLASSES = Key("materials that can be made up", least=2, most=999)
_HAPTIC, _IMAGE = 0, 1
_FIRST_IMAGE, _LAST_IMAGE = 5529, 9999
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95]


@dataclass(frozen=True)
class SyntheticSpec:
    """Size and seed of a synthetic data set.

    Attributes:
        classes: Number of materials, 2 to 999.
        recordings: Traces, and photos, of each material. The first half of the photos is taken in
            daylight, the second in ambient light.
        seed: Seed of everything, not negative.
        seconds: Duration of a trace, at least 1.
        photo_width: Width of a photo in pixels, at least 32.
        photo_height: Height of a photo in pixels, at least 32.

    Raises:
        UserError: A value is out of range.
    """

    classes: int = 12
    recordings: int = 10
    seed: int = 0
    seconds: float = 8.0
    photo_width: int = 1280
    photo_height: int = 960

    def __post_init__(self) -> None:
        """Check the ranges."""
        for name, key in (("classes", CLASSES), *walk(SyntheticConfig)):
            if not key.allows(value := getattr(self, name)):
                section = "data" if key is CLASSES else "data.synthetic"
                raise UserError(f"{section}.{name} is {value}: choose {key.range}.")


def write_folder(spec: SyntheticSpec, root: Path) -> None:
    """Write ``CLASS/haptic/NN.npy`` (float32, shape (3, T), in g) and ``CLASS/image/NN.jpg``.

    Args:
        spec: What to write.
        root: Folder to write to; missing or empty.

    Raises:
        UserError: The folder holds something already.
    """
    _prepare(root)

    def write(specimen: Specimen, index: int) -> None:
        folder = root / specimen.material.name
        (folder / "haptic").mkdir(parents=True)
        (folder / "image").mkdir()
        for recording in range(spec.recordings):
            trace = record(spec, specimen, index, recording)
            np.save(folder / "haptic" / f"{recording:02d}.npy", trace)
            photo = photograph(spec, specimen, index, recording)
            _write_jpeg(folder / "image" / f"{recording:02d}.jpg", photo)

    _for_each_class(spec, write)


def write_tum(spec: SyntheticSpec, root: Path) -> None:
    """Write the training part of the TUM haptic texture database's layout.

    ``Training/Accel/LABEL_queryN.txt`` holds one number per line, in g, at 10 kHz, the three axes
    already combined by DFT321. ``Training/Images/IMG_5529.JPG`` and on are numbered through, all of
    one class before the next, and carry no class in their names.

    Args:
        spec: What to write.
        root: Folder to write to; missing or empty.

    Raises:
        UserError: The folder holds something already, or the image numbers would pass 9999.
    """
    if spec.classes * spec.recordings > _LAST_IMAGE - _FIRST_IMAGE + 1:
        raise UserError(
            f"data.classes times data.synthetic.recordings is {spec.classes * spec.recordings}, "
            f"but the TUM layout numbers {_LAST_IMAGE - _FIRST_IMAGE + 1} photos at most; "
            "lower one of them."
        )
    _prepare(root)
    accel, images = root / "Training" / "Accel", root / "Training" / "Images"
    accel.mkdir(parents=True)
    images.mkdir()

    def write(specimen: Specimen, index: int) -> None:
        for recording in range(spec.recordings):
            trace = dft321(torch.from_numpy(record(spec, specimen, index, recording)))
            # Nine digits restore a float32 exactly.
            lines = "\n".join([f"{value:.9g}" for value in trace.tolist()])
            name = f"{specimen.material.name}_query{recording}.txt"
            (accel / name).write_text(lines + "\n", encoding="ascii")
            number = _FIRST_IMAGE + index * spec.recordings + recording
            photo = photograph(spec, specimen, index, recording)
            _write_jpeg(images / f"IMG_{number}.JPG", photo)

    _for_each_class(spec, write)


def record(
    spec: SyntheticSpec, specimen: Specimen, index: int, recording: int
) -> NDArray[np.float32]:
    """Record one trace of class ``index``, in g, shape (3, T)."""
    rng = np.random.default_rng([spec.seed, index, recording, _HAPTIC])
    return slide_tool(specimen, rng, spec.seconds, RATE)


def photograph(
    spec: SyntheticSpec, specimen: Specimen, index: int, recording: int
) -> NDArray[np.uint8]:
    """Take one photo of class ``index``, RGB, shape (photo_height, photo_width, 3)."""
    rng = np.random.default_rng([spec.seed, index, recording, _IMAGE])
    light: Light = "daylight" if recording < (spec.recordings + 1) // 2 else "ambient"
    return render_photo(specimen, rng, light, (spec.photo_width, spec.photo_height))


def _prepare(root: Path) -> None:
    if root.is_dir() and not any(root.iterdir()):
        return
    if root.exists():
        raise UserError(
            f"data.root is {root}, which is not an empty folder; name an empty or new one for the "
            "synthetic data."
        )
    root.mkdir(parents=True)


def _for_each_class(spec: SyntheticSpec, write: Callable[[Specimen, int], None]) -> None:
    """Make up and write the classes side by side; the files do not depend on the order."""
    materials = make_materials(spec.classes, spec.seed)

    def write_class(index: int) -> None:
        write(Specimen(materials[index]), index)

    # Threads do, as the work is done inside NumPy, SciPy and OpenCV, and they start anywhere.
    with ThreadPoolExecutor(min(2, os.cpu_count() or 1)) as pool:
        list(pool.map(write_class, range(spec.classes)))


def _write_jpeg(path: Path, photo: NDArray[np.uint8]) -> None:
    encoded = cv2.imencode(".jpg", cv2.cvtColor(photo, cv2.COLOR_RGB2BGR), _JPEG)[1]
    path.write_bytes(encoded.tobytes())
