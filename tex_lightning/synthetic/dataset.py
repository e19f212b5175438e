"""Write synthetic data sets to disk, in the layout of ``data=folder``."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import soundfile
from numpy.typing import NDArray

from tex_lightning.config.data import SyntheticConfig
from tex_lightning.core.devices import in_threads
from tex_lightning.errors import UserError
from tex_lightning.synthetic.camera import Light, render_photo
from tex_lightning.synthetic.materials import make_materials
from tex_lightning.synthetic.microphone import hear_stroke
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import draw_stroke, slide_tool

RATE = 10_000  # Hz of traces
SOUND_RATE = 44_100  # Hz of sounds
MAX_CLASSES = 999  # as many as their names can number
_HAPTIC, _IMAGE, _SOUND = 0, 1, 2
_JPEG = [cv2.IMWRITE_JPEG_QUALITY, 95]


def write_folder(
    classes: int,
    surfaces: SyntheticConfig,
    root: Path,
    modalities: Sequence[str] = ("haptic", "image"),
) -> None:
    """Write a data set as ``CLASS/haptic/NN.npy``, ``CLASS/image/NN.jpg``, ``CLASS/sound/NN.flac``.

    Traces are float32, shape (3, T), in g at 10 kHz. Sounds are 16 bit at 44.1 kHz, each of the
    stroke that the trace of the same number was felt in. The first half of the photos is taken in
    daylight, the second in ambient light.

    Args:
        classes: Number of materials, 2 to 999.
        surfaces: Number and size of the recordings of each, and the seed of everything.
        root: Folder to write to; missing or empty.
        modalities: Some of ``haptic``, ``image`` and ``sound``.

    Raises:
        UserError: If there are too many classes.
    """
    if classes > MAX_CLASSES:
        raise UserError(f"data.classes is {classes}: choose 2 to {MAX_CLASSES} materials.")
    materials = make_materials(classes, surfaces.seed)

    def write(index: int) -> None:
        specimen = Specimen(materials[index])
        for modality in modalities:
            suffix, take, save = _FILES[modality]
            folder = root / specimen.material.name / modality
            folder.mkdir(parents=True)
            for number in range(surfaces.recordings):
                save(folder / f"{number:02d}{suffix}", take(surfaces, specimen, index, number))

    # Threads do, as the work is done inside NumPy, SciPy and OpenCV; each takes 100 MB.
    in_threads(write, range(classes), "Rendering surfaces", threads=2)


def _rng(surfaces: SyntheticConfig, index: int, recording: int, sense: int) -> np.random.Generator:
    return np.random.default_rng([surfaces.seed, index, recording, sense])


def record(
    surfaces: SyntheticConfig, specimen: Specimen, index: int, recording: int
) -> NDArray[np.float32]:
    """Record one trace of class ``index``, in g, shape (3, T)."""
    return slide_tool(specimen, _rng(surfaces, index, recording, _HAPTIC), surfaces.seconds, RATE)


def listen(
    surfaces: SyntheticConfig, specimen: Specimen, index: int, recording: int
) -> NDArray[np.float32]:
    """Record what a microphone hears of the stroke of :func:`record`, shape (T,), in [-1, 1]."""
    contact = _rng(surfaces, index, recording, _HAPTIC)
    stroke = draw_stroke(contact, surfaces.seconds, RATE).at_rate(SOUND_RATE)
    return hear_stroke(specimen, stroke, contact, _rng(surfaces, index, recording, _SOUND))


def photograph(
    surfaces: SyntheticConfig, specimen: Specimen, index: int, recording: int
) -> NDArray[np.uint8]:
    """Take one photo of class ``index``, RGB, shape (photo_height, photo_width, 3)."""
    rng = _rng(surfaces, index, recording, _IMAGE)
    light: Light = "daylight" if recording < (surfaces.recordings + 1) // 2 else "ambient"
    return render_photo(specimen, rng, light, (surfaces.photo_width, surfaces.photo_height))


def _write_jpeg(path: Path, photo: NDArray[np.uint8]) -> None:
    encoded = cv2.imencode(".jpg", cv2.cvtColor(photo, cv2.COLOR_RGB2BGR), _JPEG)[1]
    path.write_bytes(encoded.tobytes())


_Take = Callable[[SyntheticConfig, Specimen, int, int], NDArray[Any]]
_Save = Callable[[Path, NDArray[Any]], None]
_FILES: dict[str, tuple[str, _Take, _Save]] = {
    "haptic": (".npy", record, np.save),
    "image": (".jpg", photograph, _write_jpeg),
    "sound": (".flac", listen, partial(soundfile.write, samplerate=SOUND_RATE, subtype="PCM_16")),
}
