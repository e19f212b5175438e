"""Pictures and sounds of the worst samples, small enough to be put into a page."""

import base64
import io
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import soundfile
from matplotlib import colormaps
from PIL import Image, ImageOps
from scipy.signal import spectrogram

from tex_lightning.data.decode import (
    IMAGE_FORMATS,
    IMAGE_SUFFIXES,
    SignalDecoder,
    read_trace,
    to_rate,
)
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import read_outcomes, worst_first

MOST_SAMPLES = 10
SIDE = 280  # pixels of a photo
SECONDS = 5.0  # of a signal
AUDIBLE = 8_000.0  # Hz; browsers refuse much lower rates
RANGE_DB = 60.0  # of a spectrogram
Samples = npt.NDArray[np.floating]
Medium = dict[str, str]  # kind (image or audio), name, content as a data URI


def shown_samples(directory: Path, networks: Sequence[str]) -> list[dict[str, Any]]:
    """The worst samples of the last network: wrong and confident first, then right and unsure.

    Args:
        directory: A run folder.
        networks: The names of its networks.

    Returns:
        ``network, label, predicted``, the probabilities of the latter two (``own``,
        ``probability``) and the ``media`` of those recordings that can be shown.
    """
    file = directory / "predictions" / f"{networks[-1]}.csv" if networks else directory
    if not file.is_file():
        return []
    outcomes = read_outcomes(file)
    shown = []
    for row in worst_first(outcomes)[:MOST_SAMPLES]:
        outcome = outcomes[row]
        shown.append(
            {
                "network": networks[-1],
                "label": outcome.label,
                "predicted": outcome.predicted,
                "own": outcome.class_probabilities.get(outcome.label, 0.0),
                "probability": outcome.class_probabilities.get(outcome.predicted, outcome.share),
                "media": list(_all_media(outcome.files, outcome.file_rates)),
            }
        )
    return shown


def _all_media(files: Mapping[str, str], rates: Mapping[str, float]) -> Iterator[Medium]:
    """Yield what can be shown of a sample; nothing of a file that is gone, or of a part of one."""
    for modality, file in files.items():
        path = Path(file)
        try:
            if path.suffix.lower() in IMAGE_SUFFIXES:
                yield _photo(path)
            elif path.is_file():
                yield from _signal(path, rates.get(modality))
        except (UserError, OSError):
            continue


def _photo(path: Path) -> Medium:
    with Image.open(path, formats=IMAGE_FORMATS) as image:
        image.draft("RGB", (2 * SIDE, 2 * SIDE))  # let the JPEG decoder leave out what is not seen
        small = ImageOps.exif_transpose(image).convert("RGB")
    small.thumbnail((SIDE, SIDE))
    return _jpeg(path.name, small)


def _signal(path: Path, rate: float | None) -> Iterator[Medium]:
    """Yield spectrogram and sound of the beginning of a signal tested at a rate in Hz."""
    samples, source = read_trace(path, SignalDecoder().assuming(rate))
    beginning = samples[:, : int(SECONDS * source.hz)]
    yield _jpeg("spectrogram", _spectrogram(beginning))
    yield {"kind": "audio", "name": path.name, "content": _sound(beginning, source.hz)}


def embedded(path: Path) -> str:
    """A PNG as a data URI."""
    return _data_uri("image/png", path.read_bytes())


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def _jpeg(name: str, image: Image.Image) -> Medium:
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=80)
    return {"kind": "image", "name": name, "content": _data_uri("image/jpeg", stream.getvalue())}


def _spectrogram(samples: Samples) -> Image.Image:
    """Power of all axes over time, low frequencies below, 60 dB from dark to bright."""
    count = samples.shape[1]
    length = min(512, count)
    _, _, power = spectrogram(samples, nperseg=length, noverlap=length // 8, axis=-1)
    decibels = 10 * np.log10(power.sum(axis=0) + 1e-30)
    shares = np.clip(1 + (decibels - decibels.max()) / RANGE_DB, 0, 1)
    pixels = (255 * colormaps["magma"](shares[::-1])[..., :3]).astype(np.uint8)
    return Image.fromarray(pixels).resize((SIDE, SIDE // 3))


def _sound(samples: Samples, source: float) -> str:
    """A signal as 16-bit WAV, its axes added, as loud as can be."""
    rate = round(max(AUDIBLE, source))
    heard = to_rate(samples, source, rate, "The signal").sum(axis=0)
    heard = heard - heard.mean()
    heard = heard / max(float(np.abs(heard).max()), 1e-12)
    stream = io.BytesIO()
    soundfile.write(stream, heard, rate, format="WAV", subtype="PCM_16")
    return _data_uri("audio/wav", stream.getvalue())
