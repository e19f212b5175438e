"""Find unusable recordings before time is spent on training."""

from collections.abc import Iterable, Sequence

from tex_lightning.core.progress import track
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store, Unusable, list_files
from tex_lightning.errors import UserError
from tex_lightning.senses import Sense


def find_unusable(
    recordings: Recordings,
    store: Store,
    senses: Iterable[Sense],
    damaged: Sequence[Unusable] | None = None,
    *,
    skip_bad: bool,
) -> list[Unusable]:
    """Find recordings that cannot be decoded, or give no fragment.

    Args:
        recordings: All that a task will need.
        store: Filled with them.
        damaged: Those that it could not be filled with; None fills it.
        senses: Branches that look at them.
        skip_bad: Whether the task goes on without them (``data.skip_bad``).

    Raises:
        UserError: Listing them, unless the task goes on.
    """
    damaged = store.fill(recordings) if damaged is None else damaged
    readable = recordings.without(each.recording for each in damaged)
    seen = [(row, sense) for sense in senses for row in readable.of(sense.modality)]
    small = [
        found
        for row, sense in track(seen, "Checking")
        if (found := _too_small(row, store, sense)) is not None
    ]
    unusable = list({each.recording: each for each in (*damaged, *small)}.values())
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
        "data.skip_bad=true to go on without them:",
        *list_files(unusable),
    )


def _too_small(row: Recording, store: Store, sense: Sense) -> Unusable | None:
    """A recording that is too short or too small for a single fragment."""
    try:
        sense.check(store.load(row))
    except UserError as error:
        said = f"{str(error).rstrip('.')}{_doubt(row, store, sense)}."
        return Unusable(row, f"{row.source}: {said}")
    return None


def _doubt(row: Recording, store: Store, sense: Sense) -> str:
    """Hint that a rate that no file states may be the reason."""
    if sense.medium != "signal" or (rate := store.rate(row)).source != "assumed":
        return ""
    return (
        f", or correct the rate: {rate.hz:,.6g} Hz are assumed (data.file_rate, or give the rate "
        "of this file)"
    )
