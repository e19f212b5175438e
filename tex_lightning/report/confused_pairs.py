"""The recordings behind confused pairs: what each sense took of either class."""

from collections.abc import Iterable, Sequence

import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from torch import Tensor

from tex_lightning.data.parts import cut_part, split_name
from tex_lightning.evaluation.fragments import ConfusedPair
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.figures import draw_spectrogram
from tex_lightning.report.labels import brief
from tex_lightning.senses import Sense

PHOTO_PIXELS = 300  # side of the middle of the photo that is shown
INCHES = 2.75  # that a recording is wide


def pairs_figure(
    pairs: Sequence[ConfusedPair], outcomes: Sequence[Outcome], senses: Iterable[Sense]
) -> Figure:
    """One row for each pair: the recordings of the one class, then those of the other.

    Args:
        pairs: At least one.
        outcomes: Outcomes of FusionNet, whose samples have all recordings; the first of a class is
            shown.
        senses: Branches of FusionNet, which decode them; the first of each modality does.
    """
    first: dict[str, Outcome] = {}
    for outcome in outcomes:
        first.setdefault(outcome.label, outcome)
    by_modality: dict[str, Sense] = {}
    for sense in senses:
        by_modality.setdefault(sense.modality, sense)
    count = len(by_modality)
    figure = Figure(figsize=(2 * INCHES * count, 2.6 * len(pairs)), layout="constrained")
    grid = figure.subplots(len(pairs), 2 * count, squeeze=False)
    for axes, pair in zip(grid, pairs, strict=True):
        for place, label in enumerate(pair.classes):
            own = axes[place * count : (place + 1) * count]
            for panel, (modality, sense) in zip(own, by_modality.items(), strict=True):
                path, part = split_name(first[label].files[modality])
                array = cut_part(sense.decoder.decode(path)[0], part, path)
                DRAWN[sense.medium](panel, torch.from_numpy(array), sense)
            own[0].set_title(brief(label), fontsize=8)
        axes[0].set_ylabel(
            f"confused by {pair.confused_by}\n({pair.confusion:.0%}, "
            f"{pair.separated_by} {pair.other:.0%})",
            fontsize=8,
        )
    return figure


def _draw_signal(axes: Axes, recording: Tensor, sense: Sense) -> None:
    """What the network reads of a signal."""
    with torch.inference_mode():
        planes = sense(recording)[0]
    units = draw_spectrogram(axes, planes.reshape(-1, planes.shape[-1]), sense.features)
    axes.tick_params(labelsize=6)
    axes.set_xlabel(", ".join(units), fontsize=6)


def _draw_photo(axes: Axes, recording: Tensor, sense: Sense) -> None:
    """The middle of a photo."""
    top, left = (max(0, (side - PHOTO_PIXELS) // 2) for side in recording.shape[:2])
    axes.imshow(recording[top : top + PHOTO_PIXELS, left : left + PHOTO_PIXELS].numpy())
    axes.set(xticks=[], yticks=[])


DRAWN = {"signal": _draw_signal, "photo": _draw_photo}  # by the medium of the branch
