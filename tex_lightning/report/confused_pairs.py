"""The recordings behind confused pairs: a spectrogram and a photo of either class."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tex_lightning.data.decode import DecodeSettings, decode_image, decode_trace
from tex_lightning.evaluation.fragments import ConfusedPair
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.report.figures import draw_spectrogram

PHOTO_PIXELS = 300  # side of the middle of the photo that is shown


def pairs_figure(
    pairs: Sequence[ConfusedPair], outcomes: Sequence[Outcome], settings: DecodeSettings
) -> Figure:
    """One row for each pair: spectrogram and photo of the one class, then of the other.

    Args:
        pairs: At least one.
        outcomes: Of FusionNet, whose samples have both recordings; the first of a class is shown.
        settings: How the recordings are decoded.
    """
    first: dict[str, Outcome] = {}
    for outcome in outcomes:
        first.setdefault(outcome.label, outcome)
    figure = Figure(figsize=(11, 2.6 * len(pairs)), layout="constrained")
    grid = figure.subplots(len(pairs), 4, squeeze=False)
    for axes, pair in zip(grid, pairs, strict=True):
        for place, label in enumerate(pair.classes):
            _draw_spectrogram(axes[2 * place], Path(first[label].haptic), settings)
            _draw_photo(axes[2 * place + 1], Path(first[label].image), settings)
            axes[2 * place].set_title(label, fontsize=8)
        axes[0].set_ylabel(
            f"confused by {pair.confused_by}\n({pair.confusion:.0%}, other {pair.other:.0%})",
            fontsize=8,
        )
    return figure


def _draw_spectrogram(axes: Axes, file: Path, settings: DecodeSettings) -> None:
    features = HapticFeatures(sampling_rate=settings.sampling_rate)
    magnitudes = features.magnitudes(torch.from_numpy(decode_trace(file, settings)))
    draw_spectrogram(axes, magnitudes.clamp(min=1e-12).log(), features)
    axes.tick_params(labelsize=6)
    axes.set_xlabel("s, Hz", fontsize=6)


def _draw_photo(axes: Axes, file: Path, settings: DecodeSettings) -> None:
    photo = decode_image(file, settings)
    top, left = (max(0, (side - PHOTO_PIXELS) // 2) for side in photo.shape[:2])
    axes.imshow(np.asarray(photo[top : top + PHOTO_PIXELS, left : left + PHOTO_PIXELS]))
    axes.set_axis_off()
