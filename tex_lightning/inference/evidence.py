"""Dense scores of every position of a network, and its extent in the recording.

A position is given the fragment that it begins with: the window that gives exactly one prediction,
and on which the network was trained. In a longer recording it also sees a margin around it, as far
as the network's receptive field reaches (of HapticNet 15 frames on either side). Where a network
does not say where its positions lie, the recording is taken as cut into as many equal parts.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.spectrogram import movement_start
from tex_lightning.senses.signal import SignalSense

Floats = npt.NDArray[np.floating[Any]]
Labels = npt.NDArray[np.int64]


@dataclass(frozen=True)
class Evidence:
    """Dense scores of one sense, and the extents of their positions.

    Attributes:
        name: Name of the sense.
        scores: (classes, rows, columns) float32, before softmax: a network's class scores, or what
            the sense adds to those of a FusionNet. Signals have one row.
        rows: (rows, 2) first pixel of each row of fragments and one past the last, from the top;
            not used of signals. The last may reach beyond the photo.
        columns: (columns, 2) the same from the left, in pixels; of signals begin and end in
            seconds of the recording.
        temperature: What scores are divided by before they become probabilities.
        recording: What the network reads: a photo (height, width, 3) uint8, or a signal (axes,
            samples) float32.
        rate: Rate of a signal in Hz; None for a photo.
        start: Seconds of a signal before steady movement, which the network does not read.
    """

    name: str
    scores: Floats
    rows: Floats
    columns: Floats
    temperature: float
    recording: npt.NDArray[Any]
    rate: float | None = None
    start: float = 0.0

    @property
    def labels(self) -> Labels:
        """(rows, columns) class of every position."""
        labels: Labels = self.scores.argmax(axis=0)
        return labels

    def probabilities(self, label: int) -> Floats:
        """(rows, columns) probability of a class at every position, 0 to 1."""
        scores = torch.from_numpy(self.scores).double().div(self.temperature)
        shares: Floats = scores.softmax(dim=0)[label].numpy()
        return shares

    def label_map(self, step: int = 1) -> Labels:
        """Class of the middle of squares of pixels: that of the fragment whose centre is nearest.

        Args:
            step: Side of a square.

        Returns:
            (height, width) over ``step``, rounded up; -1 where no fragment reaches.
        """
        places = [
            nearest(extents, (np.arange(0, size, step) + step / 2).clip(max=size - 0.5))
            for extents, size in zip((self.rows, self.columns), self.recording.shape, strict=False)
        ]
        labels: Labels = self.labels[np.ix_(*places)]
        labels[places[0] < 0] = -1
        labels[:, places[1] < 0] = -1
        return labels

    @property
    def seconds(self) -> float:
        """Length of a signal."""
        return float(self.recording.shape[-1] / (self.rate or 1.0))

    @property
    def edges(self) -> Floats:
        """(columns + 1,) borders of the positions of a signal, halfway between their centres."""
        return cell_edges(self.columns).clip(0, self.seconds)


def cell_edges(extents: Floats) -> Floats:
    """(places + 1,) what is nearest to each of some (places, 2) begins and ends, in order."""
    centres = extents.mean(axis=1)
    between = (centres[1:] + centres[:-1]) / 2
    return np.concatenate((extents[:1, 0], between, extents[-1:, 1]))


def nearest(extents: Floats, values: Floats) -> Labels:
    """Index of the (places, 2) begins and ends whose centre is nearest; -1 outside of all."""
    edges = cell_edges(extents)
    found: Labels = np.searchsorted(edges, values, side="right") - 1
    found[(found >= len(extents)) | (found < 0)] = -1
    return found


def window_extents(count: int, stride: int, window: int) -> Floats:
    """(count, 2) begin and end of windows that begin a stride apart."""
    begins = np.arange(count, dtype=np.float64) * stride
    return np.stack((begins, begins + window), axis=1)


def equal_parts(count: int, begin: float, end: float) -> Floats:
    """(count, 2) begin and end of equal parts of a length."""
    edges = np.linspace(begin, end, count + 1)
    return np.stack((edges[:-1], edges[1:]), axis=1)


@torch.inference_mode()
def classify_with_maps(
    classifier: SurfaceClassifier, recordings: Mapping[str, Tensor]
) -> tuple[Vote, dict[str, Evidence]]:
    """Decide on one sample as ``classify`` does, and keep the scores of every position.

    Args:
        classifier: A network, in evaluation mode.
        recordings: Decoded, by modality.

    Returns:
        The decision, and by sense what it is made of.

    Raises:
        UserError: If a recording cannot be used, or it is a baseline, which has no positions.
    """
    card = classifier.card
    refuse_baseline(classifier)
    classifier.require(dict(recordings))
    alone = classifier.fusion is None
    partials, found = [], {}
    for name, sense in classifier.senses.items():
        recording = recordings[sense.modality]
        grid = sense.dense_grid(sense.dense_input(recording), classifier.level(name))
        partial_logits = classifier.project(name, grid.flatten(1))
        partials.append(partial_logits)
        scores = partial_logits.reshape(-1, *grid.shape[1:]).cpu().numpy()
        # a temperature is fitted to the sum of all senses
        found[name] = _evidence(sense, recording, scores, card.temperature if alone else 1.0)
    logits = classifier.fuse(partials, 0 if alone else classifier.seed(**recordings))
    return classifier.decide(logits, card.temperature), found


def refuse_baseline(classifier: SurfaceClassifier) -> None:
    """Refuse a classifier without dense scores.

    Raises:
        UserError: Naming the baseline.
    """
    if classifier.card.baseline:
        raise UserError(
            f"{classifier.card.title} looks at the whole recording at once, so it has no map to "
            "draw; leave predict.figure out, or give the checkpoint of a network."
        )


def _evidence(sense: Sense, recording: Tensor, scores: Floats, temperature: float) -> Evidence:
    counts, array = scores.shape[1:], recording.cpu().numpy()
    known = sense.geometry is not None
    if isinstance(sense, SignalSense):
        rate, features = sense.decoder.sampling_rate, sense.spectrogram
        skips = getattr(sense.features, "skip_impact", False)
        start = movement_start(recording, rate) / rate if skips else 0.0
        if features is not None and known:
            frames = window_extents(counts[1], sense.stride, sense.window_size[1])
            frames[:, 1] -= 1  # the last frame begins there
            columns = start + frames * features.hop_length / rate
            columns[:, 1] += features.window_length / rate
        else:
            columns = equal_parts(counts[1], start, array.shape[-1] / rate)
        rows = np.array([[0.0, 1.0]])
        return Evidence(sense.name, scores, rows, columns, temperature, array, rate, start)
    if is_builtin(sense.features) and known:
        rows, columns = (
            window_extents(count, sense.stride, window)
            for count, window in zip(counts, sense.window_size, strict=True)
        )
    else:
        rows, columns = (
            equal_parts(count, 0, size) for count, size in zip(counts, array.shape, strict=False)
        )
    return Evidence(sense.name, scores, rows, columns, temperature, array)
