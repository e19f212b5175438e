"""Pictures and sounds as they are put into a page, and the samples that they are shown of."""

import base64
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

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
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, worst_first
from tex_lightning.inference.evidence import Evidence, PhotoEvidence, SignalEvidence, nearest
from tex_lightning.report.explanation import COLOURS, Key, overlaid

TRUE, TAKEN, OTHER = COLOURS[:3]
LEGEND = {"the true class": TRUE, "the one it was taken for": TAKEN, "any other": OTHER}
SIDE = 280  # pixels of a photo
PER_SECOND = 100  # pixels of a signal


def map_folder(directory: Path, network: str) -> Path:
    """Where a run folder has those of a network."""
    return directory / "label_maps" / network


def find_maps(directory: Path, network: str, row: int, modality: str) -> list[Path]:
    """Those of one recording, one of each sense that looks at it."""
    found = (map_folder(directory, network) / str(row) / modality).glob("*.png")
    return sorted(filter(Path.is_file, found))


def write_map(
    path: Path, evidence: Evidence, classes: Sequence[str], label: str, predicted: str
) -> None:
    """Write what a sense said of a sample as PNG.

    Args:
        path: The file.
        evidence: Of the sense.
        classes: Names in the order of the scores.
        label: The true class.
        predicted: The one it got.

    Raises:
        UserError: If it cannot be written.
    """
    named = {predicted: TAKEN, label: TRUE}  # right ones have the colour of the true class
    key = Key([*classes], 0, {i: named.get(name, OTHER) for i, name in enumerate(classes)})
    image = draw_map(evidence, key)
    write_atomically(path, lambda partial: image.save(partial, "PNG"))


def draw_map(evidence: Evidence, key: Key) -> Image.Image:
    """What every position said.

    Returns:
        Of a photo itself in grey, at most :data:`SIDE` pixels a side, under the colours of its
        classes. Of a signal a strip over the whole recording, one pixel high, :data:`PER_SECOND`
        long, transparent where no fragment reaches.
    """
    if isinstance(evidence, PhotoEvidence):
        step = -(-max(evidence.pixels.shape[:2]) // SIDE)
        return Image.fromarray((255 * overlaid(evidence, step, key)).round().astype(np.uint8))
    assert isinstance(evidence, SignalEvidence)  # there is no third kind
    count = max(1, round(evidence.seconds * PER_SECOND))
    places = nearest(evidence.columns, (np.arange(count) + 0.5) / count * evidence.seconds)
    colours = np.array([(*to_rgb(key.colour(i)), 1.0) for i in range(len(key.classes))])
    pixels = colours[evidence.labels[0, places]]
    pixels[places < 0] = 0
    return Image.fromarray((255 * pixels[None]).round().astype(np.uint8))


MOST_SAMPLES = 10
SECONDS = 5.0  # of a signal
STRIP = 14  # pixels that the label map of a signal is high
GAP = 2  # pixels between it and what is above
AUDIBLE = 8_000.0  # Hz; browsers refuse much lower rates
RANGE_DB = 60.0  # of a spectrogram
Samples = npt.NDArray[np.floating]


@dataclass(frozen=True)
class Medium:
    """A recording that can be seen or heard.

    Attributes:
        kind: ``image`` or ``audio``.
        name: Of the file.
        content: A data URI.
    """

    kind: str
    name: str
    content: str


@dataclass(frozen=True)
class Shown:
    """A sample with its recordings.

    Attributes:
        network: That classified it.
        label: The true class.
        predicted: The label it got.
        probability: Of that.
        own: Probability of the true class.
        media: Of its recordings those that can be shown.
    """

    network: str
    label: str
    predicted: str
    probability: float
    own: float
    media: list[Medium]


def embedded(path: Path) -> str:
    """A PNG as a data URI."""
    return _data_uri("image/png", path.read_bytes())


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def shown_samples(directory: Path, networks: Sequence[str]) -> list[Shown]:
    """The worst samples of the last network: wrong and sure first, then right and unsure.

    Args:
        directory: A run folder.
        networks: The names of its networks.
    """
    file = directory / "predictions" / f"{networks[-1]}.csv" if networks else directory
    if not file.is_file():
        return []
    outcomes = read_outcomes(file)
    return [
        _shown(outcomes[row], networks[-1], row, directory)
        for row in worst_first(outcomes)[:MOST_SAMPLES]
    ]


def _shown(outcome: Outcome, network: str, row: int, directory: Path) -> Shown:
    known, rates = outcome.class_probabilities, outcome.file_rates
    return Shown(
        network,
        outcome.label,
        outcome.predicted,
        known.get(outcome.predicted, outcome.share),
        known.get(outcome.label, 0.0),
        [
            medium
            for modality, file in outcome.files.items()
            for medium in _media(
                Path(file), find_maps(directory, network, row, modality), rates.get(modality)
            )
        ],
    )


def _media(path: Path, maps: Sequence[Path], rate: float | None) -> Iterator[Medium]:
    """What can be shown of a file; nothing of one that is gone, or of a part of one.

    Its ``rate`` in Hz is the one that it was tested at, if it is a signal.
    """
    try:
        if path.suffix.lower() in IMAGE_SUFFIXES:
            small = _thumbnail(path)
            yield Medium("image", path.name, _jpeg(small))
            for each in maps:
                with Image.open(each, formats=IMAGE_FORMATS) as image:
                    # perhaps of a photo brought to a square
                    own = image.resize(small.size)
                yield Medium("image", f"label map of {each.stem}", _jpeg(own))
        elif path.is_file():
            samples, source = read_trace(path, SignalDecoder().assuming(rate))
            heard = samples[:, : int(SECONDS * source.hz)]
            name = ", ".join(["spectrogram", *(f"label map of {each.stem}" for each in maps)])
            strips = [_strip(each, heard.shape[1] / samples.shape[1]) for each in maps]
            yield Medium("image", name, _jpeg(_stacked([_spectrogram(heard), *strips])))
            yield Medium("audio", path.name, _sound(heard, source.hz))
    except (UserError, OSError):
        return


def _thumbnail(path: Path) -> Image.Image:
    with Image.open(path, formats=IMAGE_FORMATS) as image:
        image.draft("RGB", (2 * SIDE, 2 * SIDE))  # let the JPEG decoder leave out what is not seen
        small = ImageOps.exif_transpose(image).convert("RGB")
    small.thumbnail((SIDE, SIDE))
    return small


def _jpeg(image: Image.Image) -> str:
    stream = io.BytesIO()
    image.save(stream, "JPEG", quality=80)
    return _data_uri("image/jpeg", stream.getvalue())


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


def _strip(path: Path, share: float) -> Image.Image:
    """The first ``share`` of the label map of a signal."""
    with Image.open(path, formats=IMAGE_FORMATS) as image:
        box = (0, 0, share * image.width, image.height)
        return image.resize((SIDE, STRIP), Image.Resampling.NEAREST, box)


def _stacked(images: Sequence[Image.Image]) -> Image.Image:
    """All of them below one another, on black."""
    canvas = Image.new("RGB", (SIDE, sum(image.height + GAP for image in images) - GAP))
    top = 0
    for image in images:
        canvas.paste(image, (0, top), image if image.mode == "RGBA" else None)
        top += image.height + GAP
    return canvas


def _sound(samples: Samples, source: float) -> str:
    """A signal as 16-bit WAV, its axes added, as loud as can be."""
    rate = round(max(AUDIBLE, source))
    heard = to_rate(samples, source, rate, "The signal").sum(axis=0)
    heard = heard - heard.mean()
    heard = heard / max(float(np.abs(heard).max()), 1e-12)
    stream = io.BytesIO()
    soundfile.write(stream, heard, rate, format="WAV", subtype="PCM_16")
    return _data_uri("audio/wav", stream.getvalue())
