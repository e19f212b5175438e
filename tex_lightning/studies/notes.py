"""What looks wrong in recordings before anything is trained or tested, a sentence each."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple, cast

from tex_lightning.data.decode import ASSUMED, SignalDecoder
from tex_lightning.data.recordings import Recording, Recordings, plural
from tex_lightning.data.store import Store
from tex_lightning.errors import listed
from tex_lightning.studies.dataset import Dataset
from tex_lightning_runtime.quality import MEASURES

MAX_NOTES = 5  # notes of files that the opening lists
# Ratios of levels, and of pixels, that follow each other, from which on recordings are told to be
# of another unit or camera; of the levels of one data set they were 1.5 at most.
UNITS_APART, SIZES_APART = 100.0, 4.0


def recording_notes(dataset: Dataset) -> list[str]:
    """Return what looks wrong in recordings: rates, axes, units, sizes, how files were read."""
    notes: list[str] = []
    for modality, decoder in dataset.store.decoders.items():
        rows = dataset.recordings.of(modality)
        of_signals = rate_warnings, assumed_rate, other_axes, silent, other_units, reading_notes
        looks = of_signals if isinstance(decoder, SignalDecoder) else (other_cameras,)
        for notes_on in looks if len(rows) else ():
            notes += notes_on(rows, dataset.store)
    return notes


def assumed_rate(signals: Recordings, store: Store) -> list[str]:
    """Say that nobody has given the rate of signals, of which everything depends on it."""
    rows = [row for row in signals if store.reading(row).rate_from.startswith(ASSUMED)]
    if not rows:
        return []
    return [
        f"The rate of {len(rows)} of {len(signals)} {plural(rows[0].modality)} is only assumed, "
        f"{store.rate(rows[0]):,.6g} Hz: neither file nor table says it, so give data.file_rate=HZ "
        "(an estimator: rate)."
    ]


def rate_warnings(signals: Recordings, store: Store) -> list[str]:
    """Warn of signals of a much lower rate than others."""
    modality = signals.rows[0].modality
    rates = {row: store.rate(row) for row in signals}
    highest = min(max(rates.values()), cast(SignalDecoder, store.decoders[modality]).sampling_rate)
    low = [row for row, hz in rates.items() if hz * MEASURES["rate"][0] < highest]
    if not low:
        return []
    slowest = min(low, key=lambda row: rates[row])
    return [
        f"{len(low)} of {len(rates)} {plural(modality)} have a lower rate than the {highest:,.6g} "
        f"Hz of others, {rates[slowest]:,.6g} Hz in {slowest.path.name}, and nothing above half of "
        f"it: record all at one rate, or set data.sampling_rate={rates[slowest]:g}."
    ]


def other_axes(signals: Recordings, store: Store) -> list[str]:
    """Warn of classes, or files in every class, with other names of columns than others share."""
    files: dict[tuple[str, ...], list[str]] = defaultdict(list)
    for row in signals:
        if axes := store.reading(row).axes:
            files[axes].append(row.label)
    classes = {axes: {*labels} for axes, labels in files.items()}
    usual = max(classes, key=lambda axes: len(classes[axes]), default=())
    odd = {axes: [*labels - classes[usual]] for axes, labels in classes.items() if axes != usual}
    if len(classes.get(usual, ())) < 2:
        return []
    remedy = "choose axes that all have by data.channels, or leave"
    return [
        f"{listed(sorted(labels))} alone has the axes {', '.join(axes)}, and other classes "
        f"{', '.join(usual)}: sensors may be told apart in place of classes; {remedy} it out."
        if labels
        else f"{len(files[axes])} of {len(signals)} have the axes {', '.join(axes)}, and others "
        f"{', '.join(usual)}: these are sensors side by side; {remedy} out one of them."
        for axes, labels in odd.items()
    ]


def silent(signals: Recordings, store: Store) -> list[str]:
    """Warn of signals that never change, as of a sensor that was not connected."""
    rows = [row for row in signals if store.level(row) == 0]
    if not rows:
        return []
    return [
        f"{len(rows)} of {len(signals)} {plural(rows[0].modality)} never change, the first of them "
        f"{rows[0].path.name} of {rows[0].label}: repair the recordings or take them out."
    ]


def other_units(signals: Recordings, store: Store) -> list[str]:
    """Warn of signals that are so much stronger or weaker than others that their unit differs."""
    levels = {row: level for row in signals if (level := store.level(row))}
    camps = _camps(levels)
    if camps.ratio < UNITS_APART:
        return []
    return [
        f"{_compared(levels, camps, ('strong', 'weak'), 'level')}: bring all to one unit and gain, "
        "or these are told apart in place of materials."
    ]


def other_cameras(photos: Recordings, store: Store) -> list[str]:
    """Warn of classes whose photos are much larger or smaller than those of all others."""
    sizes = {row: store.extent(row) for row in photos}
    camps = _camps(sizes)
    if camps.ratio < SIZES_APART or camps.shared:
        return []
    return [
        f"{_compared(sizes, camps, ('large', 'small'), 'megapixels')}: cameras or distances may be "
        "told apart in place of materials; take photos of all classes alike."
    ]


class Camps(NamedTuple):
    """The fewer and the more recordings beside the widest step of a value, and its ratio.

    Those at the step come first.
    """

    odd: Sequence[Recording]
    others: Sequence[Recording]
    ratio: float

    @property
    def shared(self) -> set[str]:
        """Classes that are on both sides."""
        return {row.label for row in self.odd} & {row.label for row in self.others}


def _camps(values: Mapping[Recording, float]) -> Camps:
    rows = sorted(values, key=values.__getitem__)
    steps = [values[above] / values[below] for below, above in pairwise(rows)]
    ratio = max(steps, default=1.0)
    at = steps.index(ratio) + 1 if steps else 0
    fewer, more = sorted((rows[at:], rows[:at][::-1]), key=len)
    return Camps(fewer, more, ratio)


def _compared(
    values: Mapping[Recording, float], camps: Camps, words: tuple[str, str], measure: str
) -> str:
    """Say how many recordings are odd, of which classes if these have no other, and how far.

    The words are what they are if their values are larger, and if smaller.
    """
    one, other = camps.odd[0], camps.others[0]
    labels = sorted({row.label for row in camps.odd})
    whose = "" if camps.shared else f", of {listed(labels)} alone,"
    return (
        f"{len(camps.odd)} of {len(values)} {plural(one.modality)}{whose} are {camps.ratio:,.0f} "
        f"times as {words[values[one] < values[other]]} as any other ({measure}: "
        f"{values[one]:.3g} in {one.path.name}, {values[other]:.3g} in {other.path.name})"
    )


def reading_notes(signals: Recordings, store: Store) -> list[str]:
    """Say what was skipped, filled or is in doubt, and in which files."""
    found: dict[str, list[Path]] = defaultdict(list)
    for row in signals:
        for note in store.reading(row).notes:
            found[note].append(row.path)
    notes = [
        f"{first}{f' and {len(others)} more' if others else ''}: {note}."
        for note, (first, *others) in found.items()
    ]
    more = [f"And {len(notes) - MAX_NOTES} more such notes."] if len(notes) > MAX_NOTES else []
    return notes[:MAX_NOTES] + more
