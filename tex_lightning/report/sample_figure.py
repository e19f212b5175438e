"""The figure of a test sample: its recordings, and the class at every position of the networks."""

from collections import Counter
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import torch
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.report.style import brief, looks, styled
from tex_lightning.senses.features.spectrogram import movement_start
from tex_lightning.senses.signal import SignalSense
from tex_lightning.text import printable

SIZE = (9.0, 3.0)  # inches of a sense
FRAME = 512  # samples of a column of the spectrogram
Array = npt.NDArray[np.floating]


@styled
def sample_figure(
    classifier: SurfaceClassifier, recordings: Mapping[str, Tensor], title: str
) -> Figure:
    """Draw the recordings of a sample, and the class with the largest score at every position.

    Positions are drawn as equal parts of a photo, or of the movement in a signal.

    Args:
        classifier: A network, in evaluation mode.
        recordings: Decoded recordings by modality.
        title: A line above the figure.
    """
    labels = {
        name: _position_labels(classifier, name, recordings[sense.modality])
        for name, sense in classifier.senses.items()
    }
    counts = Counter(name for grid in labels.values() for name in grid.ravel().tolist())
    colours = {name: look.colour for name, look in looks(dict(counts.most_common())).items()}
    figure = Figure(figsize=(SIZE[0], SIZE[1] * len(labels)), layout="constrained")
    figure.suptitle(printable(title))
    parts = figure.subfigures(len(labels), 1, squeeze=False)[:, 0]
    for part, (name, grid) in zip(parts, labels.items(), strict=True):
        sense = classifier.senses[name]
        recording = recordings[sense.modality].cpu()
        painted = np.array([[to_rgb(colours[label]) for label in row] for row in grid])
        if isinstance(sense, SignalSense):
            rate, skips = sense.decoder.sampling_rate, getattr(sense.features, "skip_impact", False)
            start = movement_start(recording, rate) if skips else 0
            _draw_signal(part, recording.numpy(), painted, rate, start / rate)
        else:
            _draw_photo(part, recording.numpy(), painted)
    patches = [Patch(color=colour, label=brief(name)) for name, colour in colours.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=3)
    return figure


@torch.inference_mode()
def _position_labels(
    classifier: SurfaceClassifier, name: str, recording: Tensor
) -> npt.NDArray[np.str_]:
    """Return the class name (rows, columns) at every position of one sense."""
    sense = classifier.senses[name]
    grid = sense.dense_grid(sense.dense_input(recording), classifier.level(name))
    indices = classifier.project(name, grid.flatten(1)).argmax(dim=0).reshape(grid.shape[1:])
    names: npt.NDArray[np.str_] = np.array(classifier.card.classes)[indices.cpu().numpy()]
    return names


def _draw_photo(figure: SubFigure, photo: Array, painted: Array) -> None:
    """Draw a photo (height, width, 3), and beside it colours (rows, columns, 3) over it."""
    height, width = photo.shape[:2]
    plain, covered = figure.subplots(1, 2)
    plain.imshow(photo)
    covered.imshow(photo.mean(axis=2), cmap="gray")
    covered.imshow(painted, extent=(0, width, height, 0), alpha=0.5)


def _draw_signal(
    figure: SubFigure, signal: Array, painted: Array, rate: float, start: float
) -> None:
    """Draw the spectrogram of the strongest axis, and colours (1, columns, 3) from ``start`` on."""
    spectrogram, strip = figure.subplots(2, 1, sharex=True, height_ratios=(5, 1))
    strongest = signal[signal.std(axis=1).argmax()]
    length = min(FRAME, len(strongest))
    spectrogram.specgram(
        strongest, NFFT=length, Fs=rate, noverlap=length // 2, detrend="mean", cmap="magma"
    )
    spectrogram.set(ylabel="Hz")
    seconds = len(strongest) / rate
    strip.imshow(painted, extent=(start, seconds, 0, 1), aspect="auto")
    strip.set(xlim=(0, seconds), yticks=[], xlabel="s", ylabel="class")
