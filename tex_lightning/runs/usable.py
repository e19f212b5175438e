"""Which recordings can be used at all: found out before time is spent on training."""

from tex_lightning.classifier import check_frames, check_side
from tex_lightning.data.datamodule import load_trace
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store
from tex_lightning.data.unusable import Unusable, list_files
from tex_lightning.errors import UserError
from tex_lightning.features.spectrogram import HapticFeatures


def find_unusable(
    recordings: Recordings,
    store: Store,
    features: HapticFeatures | None,
    min_side: int,
    *,
    skip_bad: bool,
) -> list[Unusable]:
    """Decode recordings and find those that cannot be, or give no fragment.

    Args:
        recordings: All that a task will need.
        store: Filled with them.
        features: Of the traces; None for a network on photos.
        min_side: Of a photo in pixels.
        skip_bad: Whether the task goes on without them (``data.skip_bad``).

    Raises:
        UserError: Listing them, unless the task goes on.
    """
    damaged = store.fill(recordings)
    readable = recordings.without(each.recording for each in damaged)
    unusable = [*damaged, *_find_too_small(readable, store, features, min_side)]
    if unusable and not skip_bad:
        refuse(unusable, len(recordings))
    return unusable


def refuse(unusable: list[Unusable], count: int) -> None:
    """End with the list of all files out of ``count`` that cannot be used.

    Raises:
        UserError: Always.
    """
    raise UserError(
        f"{len(unusable)} of {count} files cannot be used; repair them, take them out or set "
        f"data.skip_bad=true to go on without them:\n{list_files(unusable)}"
    )


def _find_too_small(
    recordings: Recordings, store: Store, features: HapticFeatures | None, min_side: int
) -> list[Unusable]:
    """The recordings that are too short or too small for a single fragment."""
    found = []
    for row in recordings:
        try:
            _check_size(row, store, features, min_side)
        except UserError as error:
            found.append(Unusable(row, f"{row.path}: {error}"))
    return found


def _check_size(
    row: Recording, store: Store, features: HapticFeatures | None, min_side: int
) -> None:
    if row.modality == "image":
        height, width, _ = store.image(row).shape
        check_side(height, width, min_side)
    elif features is not None:
        try:
            check_frames(features.count_frames(load_trace(row, store)), features)
        except UserError as error:
            rate = store.rate(row)
            if rate.source != "assumed":
                raise
            raise UserError(
                f"{str(error).rstrip('.')}, or correct the rate: {rate.hz:,.6g} Hz are assumed "
                "(data.file_rate, or give the rate of this file)."
            ) from error
