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
from matplotlib.colors import to_rgb
from PIL import Image, ImageOps
from scipy.signal import spectrogram

from tex_lightning.core.files import write_atomically
from tex_lightning.data.decode import (
    IMAGE_FORMATS,
    IMAGE_SUFFIXES,
    SignalDecoder,
    read_trace,
    to_rate,
)
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import read_outcomes, worst_first
from tex_lightning.inference.evidence import Evidence, PhotoEvidence, SignalEvidence, nearest
from tex_lightning.report.explanation import COLOURS, overlaid

TRUE, TAKEN, OTHER = COLOURS[:3]
LEGEND = {"the true class": TRUE, "the one it was taken for": TAKEN, "any other": OTHER}
MOST_SAMPLES = 10
SIDE = 280  # pixels of a photo
PER_SECOND = 100  # pixels of the label map of a signal
SECONDS = 5.0  # of a signal
STRIP = 14  # pixels that the label map of a signal is high
GAP = 2  # pixels between it and what is above
AUDIBLE = 8_000.0  # Hz; browsers refuse much lower rates
RANGE_DB = 60.0  # of a spectrogram
Samples = npt.NDArray[np.floating]
Medium = dict[str, str]  # kind (image or audio), name, content as a data URI


def map_folder(directory: Path, network: str) -> Path:
    """Where a run folder has the label maps of a network."""
    return directory / "label_maps" / network


def write_map(
    path: Path, evidence: Evidence, classes: Sequence[str], label: str, predicted: str
) -> None:
    """Write what a sense said of every position of a sample as PNG.

    Of a photo it is the photo in grey, at most :data:`SIDE` pixels a side, under the colours of
    its classes; of a signal a strip over the whole recording, one pixel high, :data:`PER_SECOND`
    long, transparent where no fragment reaches.

    Args:
        path: The file.
        evidence: Of the sense.
        classes: Names in the order of the scores.
        label: The true class.
        predicted: The one it got.

    Raises:
        UserError: If it cannot be written.
    """
    named = {predicted: TAKEN, label: TRUE}  # correct ones have the colour of the true class
    colours = [named.get(name, OTHER) for name in classes]
    if isinstance(evidence, PhotoEvidence):
        pixels = overlaid(evidence, -(-max(evidence.pixels.shape[:2]) // SIDE), colours)
    else:
        assert isinstance(evidence, SignalEvidence)  # there is no third kind
        count = max(1, round(evidence.seconds * PER_SECOND))
        places = nearest(evidence.columns, (np.arange(count) + 0.5) / count * evidence.seconds)
        painted = np.array([(*to_rgb(colour), 1.0) for colour in colours])
        pixels = painted[evidence.labels[0, places]]
        pixels[places < 0] = 0
        pixels = pixels[None]
    image = Image.fromarray((255 * pixels).round().astype(np.uint8))
    write_atomically(path, lambda partial: image.save(partial, "PNG"))


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
        outcome, folder = outcomes[row], map_folder(directory, networks[-1]) / str(row)
        shown.append(
            {
                "network": networks[-1],
                "label": outcome.label,
                "predicted": outcome.predicted,
                "own": outcome.class_probabilities.get(outcome.label, 0.0),
                "probability": outcome.class_probabilities.get(outcome.predicted, outcome.share),
                "media": list(_all_media(outcome.files, outcome.file_rates, folder)),
            }
        )
    return shown


def _all_media(
    files: Mapping[str, str], rates: Mapping[str, float], folder: Path
) -> Iterator[Medium]:
    """What can be shown of a sample; nothing of a file that is gone, or of a part of one."""
    for modality, file in files.items():
        path, maps = Path(file), sorted((folder / modality).glob("*.png"))
        try:
            if path.suffix.lower() in IMAGE_SUFFIXES:
                yield from _photo_media(path, maps)
            elif path.is_file():
                yield from _signal_media(path, maps, rates.get(modality))
        except (UserError, OSError):
            continue


def _photo_media(path: Path, maps: Sequence[Path]) -> Iterator[Medium]:
    with Image.open(path, formats=IMAGE_FORMATS) as image:
        image.draft("RGB", (2 * SIDE, 2 * SIDE))  # let the JPEG decoder leave out what is not seen
        small = ImageOps.exif_transpose(image).convert("RGB")
    small.thumbnail((SIDE, SIDE))
    yield _jpeg(path.name, small)
    for each in maps:
        with Image.open(each, formats=IMAGE_FORMATS) as image:  # perhaps brought to a square
            yield _jpeg(f"label map of {each.stem}", image.resize(small.size))


def _signal_media(path: Path, maps: Sequence[Path], rate: float | None) -> Iterator[Medium]:
    """Spectrogram above the label maps, and the sound, of a signal tested at a rate in Hz."""
    samples, source = read_trace(path, SignalDecoder().assuming(rate))
    heard = samples[:, : int(SECONDS * source.hz)]
    canvas = Image.new("RGB", (SIDE, SIDE // 3 + len(maps) * (STRIP + GAP)))
    canvas.paste(_spectrogram(heard))
    share = heard.shape[1] / samples.shape[1]
    for number, each in enumerate(maps):
        with Image.open(each, formats=IMAGE_FORMATS) as image:
            box = (0, 0, share * image.width, image.height)
            strip = image.resize((SIDE, STRIP), Image.Resampling.NEAREST, box)
        top = SIDE // 3 + GAP + number * (STRIP + GAP)
        canvas.paste(strip, (0, top), strip)
    yield _jpeg(", ".join(["spectrogram", *(f"label map of {each.stem}" for each in maps)]), canvas)
    yield {"kind": "audio", "name": path.name, "content": _sound(heard, source.hz)}


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
    step = length - length // 8
    _, _, power = spectrogram(samples, nperseg=length, noverlap=length // 8, axis=-1)
    decibels = 10 * np.log10(power.sum(axis=0) + 1e-30)
    shares = np.clip(1 + (decibels - decibels.max()) / RANGE_DB, 0, 1)
    pixels = (255 * colormaps["magma"](shares[::-1])[..., :3]).astype(np.uint8)
    # from the first sample to the last one, which lie beyond the middles of the outer windows
    padded = np.pad(pixels, ((0, 0), (2, 2), (0, 0)), mode="edge")
    begin, end = ((place - length / 2) / step + 2.5 for place in (0, count))
    size, box = (SIDE, SIDE // 3), (begin, 0, end, len(padded))
    return Image.fromarray(padded).resize(size, box=box)


def _sound(samples: Samples, source: float) -> str:
    """A signal as 16-bit WAV, its axes added, as loud as can be."""
    rate = round(max(AUDIBLE, source))
    heard = to_rate(samples, source, rate, "The signal").sum(axis=0)
    heard = heard - heard.mean()
    heard = heard / max(float(np.abs(heard).max()), 1e-12)
    stream = io.BytesIO()
    soundfile.write(stream, heard, rate, format="WAV", subtype="PCM_16")
    return _data_uri("audio/wav", stream.getvalue())
