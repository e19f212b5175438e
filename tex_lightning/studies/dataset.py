"""Open a data set: recordings and store, decoded and checked."""

import logging
from collections import Counter, defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from rich.text import Text

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DataConfig, Folding
from tex_lightning.core.console import QUIET, Screen, console
from tex_lightning.core.progress import track
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.folds import (
    Split,
    absent_classes,
    check_split,
    make_samples,
    split,
    tested_part,
)
from tex_lightning.data.quality import MEASURES
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings, one_name, plural
from tex_lightning.data.store import Store, Unusable, cache_root, list_files
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.conditions import Bins, condition_bins
from tex_lightning.senses.base import Sense
from tex_lightning.studies.leaks import as_trained, is_own, refuse_leak
from tex_lightning.text import printable_lines
from tex_lightning_runtime.columns import Reading

MAX_KINDS, MAX_NOTES = 5, 5  # ways of reading, and notes of files, that the opening lists
log = logging.getLogger(__name__)
SHOWN = 3  # parts that lack classes


@dataclass(frozen=True)
class Dataset:
    """Recordings of one task, decoded.

    Attributes:
        classes: Class names in natural order.
        recordings: Recordings of the modalities that the model needs.
        unknown: Recordings of held-out classes, used only in their own test.
        store: Decoded files.
        skipped: Files that are left out since they cannot be used (``data.skip_bad``).
        condition_bins: Bins of conditions with many values, see
            :func:`~tex_lightning.evaluation.conditions.condition_bins`.
    """

    classes: list[str]
    recordings: Recordings
    unknown: Recordings
    store: Store
    skipped: tuple[Unusable, ...] = ()
    condition_bins: Bins = field(default_factory=dict)

    @classmethod
    def decode(
        cls, recordings: Recordings, unknown: Recordings, store: Store, classes: list[str]
    ) -> "Dataset":
        """Fill the store; what cannot be decoded is left out."""
        damaged = store.fill([*recordings, *unknown])
        bad = [unusable.recording for unusable in damaged]
        known, held = recordings.without(bad), unknown.without(bad)
        return cls(classes, known, held, store, tuple(damaged))

    def usable(self, senses: Iterable[Sense], *, skip_bad: bool) -> "Dataset":
        """Drop the recordings that give no fragment as well.

        Args:
            senses: Senses that read them.
            skip_bad: Whether the task goes on without the files left out (``data.skip_bad``).

        Raises:
            UserError: Listing them, unless the task goes on.
        """
        rows = Recordings((*self.recordings, *self.unknown))
        pairs = [(row, sense) for sense in senses for row in rows.of(sense.modality)]
        small = {}
        for row, sense in track(pairs, "Checking"):
            try:
                sense.check(self.store.load(row))
            except UserError as error:
                small[row] = Unusable(row, f"{row.source}: {error}")
        skipped = (*self.skipped, *small.values())
        if skipped and not skip_bad:
            raise UserError(
                f"{len(skipped)} of {len(rows) + len(self.skipped)} files cannot be used; repair "
                "them, take them out or set data.skip_bad=true to go on without them:",
                *list_files(skipped),
            )
        if skipped:
            files = "\n".join(list_files(skipped))
            log.warning("Going on without %d files:\n%s", len(skipped), files)
        known, held = self.recordings.without(small), self.unknown.without(small)
        return replace(self, recordings=known, unknown=held, skipped=skipped)

    def absences(self, divisions: Iterable[Folding]) -> list[str]:
        """Say in a sentence which parts are tested, or chosen on, without all classes.

        Args:
            divisions: Division of each training.
        """
        absent: dict[str, list[str]] = {}
        for by in divisions:
            parts = split(self.recordings, by, trains=True)
            validation = f"fold {by.val_fold}, which chooses epoch and temperature,"
            for part, name in ((parts.test, tested_part(by)), (parts.val, validation)):
                lacks = absent_classes(part, self.classes, tuple(self.store.decoders))
                if lacks and len(part):
                    absent[name] = lacks
        told = [f"{name} has none of {listed(lacks)}" for name, lacks in absent.items()]
        more = [f"{len(told) - SHOWN} more parts lack some"] if len(told) > SHOWN else []
        return [
            f"Not all classes are everywhere: {'; '.join([*told[:SHOWN], *more])}. What is "
            "measured there says nothing of them: record more groups of these classes, or take "
            "fewer folds (data.folds)."
        ][: len(told)]

    def parts(self, by: Folding) -> Split:
        """Return training, validation and test recordings, checked."""
        parts = split(self.recordings, by, trains=True)
        check_split(parts, self.classes, tuple(self.store.decoders), by)
        return parts


def open_dataset(data: DataConfig, senses: Sequence[Sense]) -> Dataset:
    """Read the data set to train on, and decode what the cache does not have.

    Args:
        data: Where recordings come from.
        senses: Senses that will be trained on them.

    Raises:
        UserError: If the data cannot be used.
    """
    store = Store(cache_root(data.cache_dir), {sense.modality: sense.decoder for sense in senses})
    modalities = tuple(store.decoders)
    rows = read_recordings(data, modalities)
    needed = rows.without(row for row in rows if row.modality not in modalities)
    recordings, unknown = hold_out(needed, data.hold_out)
    if len(recordings.classes) < 2:
        raise UserError(
            f"The data has {' or '.join(modalities)} recordings of "
            f"{listed(recordings.classes) or 'no class'}, and telling classes apart takes two; "
            "choose another model or add recordings."
        )
    dataset = Dataset.decode(recordings, unknown, store, recordings.classes)
    return replace(dataset, condition_bins=condition_bins(needed))


def open_test_data(
    data: DataConfig, classifier: SurfaceClassifier, who: str, *, choose: bool = False
) -> tuple[Dataset, DataConfig]:
    """Read what a checkpoint is tested on, decoded as the checkpoint says.

    Only ``data.file_rate`` belongs to the files themselves and counts if it is given.

    Args:
        data: Where recordings come from, and what of them is tested.
        classifier: Tested classifier.
        who: Name of the classifier in messages.
        choose: Whether nobody has said which fold is tested: of the data that it was trained on
            that which its training left out, of all others everything.

    Returns:
        The test recordings, and the division that they are the test part of.

    Raises:
        UserError: If classes are unknown to the checkpoint, it was trained on these recordings, or
            they cannot be used.
    """
    card = classifier.card
    own = as_trained(data, card) if choose else data
    given = replace(own, test_where=data.test_where)  # other data may lack the training's
    table = read_recordings(given, card.modalities, least=1)
    if choose and is_own(table, own, card):
        data = given if data.test_where else own
    rows, held = hold_out(table, data.hold_out)
    if unknown := [label for label in rows.classes if label not in card.classes]:
        raise UserError(
            f"{who} does not know the class {listed(unknown)}; leave it out of the "
            "data, name it in data.hold_out or train on it."
        )

    def tested(part: Recordings) -> Recordings:
        wanted = part.without(row for row in part if row.modality not in card.modalities)
        test = split(wanted, data).test
        refuse_leak(test, card, who, data)
        return replace(test, notes=part.notes)

    store = open_store(data, classifier)
    opened = Dataset.decode(tested(rows), tested(held), store, card.classes)
    dataset = opened.usable(classifier.senses.values(), skip_bad=data.skip_bad)
    if not make_samples(dataset.recordings, card.modalities):
        raise UserError(
            f"{who} has nothing to be tested on in {tested_part(data)}; choose another "
            "data.test_fold or data.test_where, or data.test_fold=null for everything."
        )
    used = table.without(row for row in table if row.modality not in card.modalities)
    return replace(dataset, condition_bins=condition_bins(used)), data


def open_store(data: DataConfig, classifier: SurfaceClassifier) -> Store:
    """Open a store that decodes recordings with a checkpoint's settings."""
    decoders = {
        sense.modality: sense.decoder.assuming(data.file_rate, data.channels, data.time_unit)
        for sense in classifier.senses.values()
    }
    return Store(cache_root(data.cache_dir), decoders)


def hold_out(recordings: Recordings, classes: list[str] | None) -> tuple[Recordings, Recordings]:
    """Divide recordings into those of known classes and those of the classes named.

    Raises:
        UserError: If there is no such class.
    """
    classes = None if classes is None else [one_name(label) for label in classes]
    if absent := sorted(set(classes or ()) - set(recordings.classes)):
        raise UserError(
            f"data.hold_out names {listed(absent)}, and the data has no such class; choose from "
            f"{listed(recordings.classes)}, with commas between names."
        )
    known = [label for label in recordings.classes if label not in (classes or ())]
    return recordings.in_classes(known), recordings.in_classes(classes or [])


def show_opening(
    data: DataConfig, dataset: Dataset, what: str, *, trains: Iterable[Folding] = ()
) -> None:
    """Warn of what was passed over or looks wrong; print the data and what is done with it.

    Args:
        data: Where the recordings come from.
        dataset: All that will be trained or tested on.
        what: Description of the training or test.
        trains: Division of each training; without any there is only a test.
    """
    rows = dataset.recordings
    modalities = list(dict.fromkeys(row.modality for row in rows))
    divisions = list(trains)
    warnings = [*rows.notes, *dataset.absences(divisions)]
    for modality in modalities:
        warnings += rate_warnings(rows.of(modality), dataset.store)
        warnings += reading_notes(rows.of(modality), dataset.store)
    for text in warnings:
        log.warning("%s", text)
    if Screen.verbose == QUIET:
        return

    def show(title: str, text: str, *, whole: bool = False) -> None:
        line = Text(f"{title:<8} {printable_lines(text)}")
        console.print(line, no_wrap=not whole, overflow=None if whole else "ellipsis")

    show("Data", f"{data.name} {data.manifest or data.root or ''}")
    show("Classes", f"{len(rows.classes)}: {', '.join(rows.classes)}")
    for modality in modalities:
        signals, title = rows.of(modality), plural(modality).partition(" ")[0].capitalize()
        decoder, counts = dataset.store.decoders[modality], Counter(row.label for row in signals)
        sizes = [dataset.store.extent(row) for row in signals]
        size = _spread(sizes, decoder.unit, decoder.precision)
        show(title, f"{len(signals)}; {size}; {_spread([*counts.values()], '', 'd')} of a class")
        for text in readings(signals, dataset.store):
            show("Reads", text, whole=True)
    if divisions:
        show("Folds", _folds(divisions))
    show("Trains" if divisions else "Tests", what)


def _folds(divisions: Sequence[Folding]) -> str:
    """Say how recordings are divided for one training, or for several in turn."""
    by, count = divisions[0], divisions[0].folds
    tests = [division for division in divisions if division.withholds]
    if not tests:
        but = "" if by.val_fold is None else f" but fold {by.val_fold}, which chooses the epoch"
        return f"{count}; all are trained on{but}, and nothing is tested"
    if len(tests) < len(divisions):
        return f"{_folds(tests)}; then all are trained on"
    if len(tests) > 1:
        return f"{count}, of which {len(tests)} are tested, one after the other"
    if by.inverted and by.test_fold is not None:
        return f"{count}, of which fold {by.test_fold} is trained on and the others are tested"
    chosen = "" if by.val_fold is None else f", and fold {by.val_fold} chooses the epoch"
    return f"{count}, of which {tested_part(by)} is tested{chosen}"


def _spread(values: Sequence[float], unit: str, form: str) -> str:
    """Return the smallest and the largest value in a format, once if they read alike."""
    low, high = format(min(values), form), format(max(values), form)
    return f"{low if low == high else f'{low} to {high}'} {unit}".rstrip()


def rate_warnings(signals: Recordings, store: Store) -> list[str]:
    """Warn of signals of a much lower rate than others."""
    modality = signals.rows[0].modality
    decoder = store.decoders[modality]
    if not isinstance(decoder, SignalDecoder):
        return []
    rates = {row: store.rate(row) for row in signals}
    highest = min(max(rates.values()), decoder.sampling_rate)
    low = [row for row, hz in rates.items() if hz * MEASURES["rate"][0] < highest]
    if not low:
        return []
    slowest = min(low, key=lambda row: rates[row])
    return [
        f"{len(low)} of {len(rates)} {plural(modality)} have a lower rate than the {highest:,.6g} "
        f"Hz of others, {rates[slowest]:,.6g} Hz in {slowest.path.name}, and nothing above half of "
        f"it: record all at one rate, or set data.sampling_rate={rates[slowest]:g}."
    ]


def readings(signals: Recordings, store: Store) -> list[str]:
    """Say how files of signals were read: once for all that agree, those of most files first."""
    if not isinstance(store.decoders[signals.rows[0].modality], SignalDecoder):
        return []
    rates: dict[Reading, list[float]] = defaultdict(list)
    first: dict[Reading, str] = {}
    for row in signals:
        kind = replace(store.reading(row), notes=())
        rates[kind].append(store.rate(row))
        first.setdefault(kind, row.path.name)
    said = []
    for kind, values in sorted(rates.items(), key=lambda each: -len(each[1]))[:MAX_KINDS]:
        some = "" if len(rates) == 1 else f"{len(values)} as {first[kind]}: "
        said.append(some + kind.said(*sorted({min(values), max(values)})))
    more = len(rates) - MAX_KINDS
    return [*said, f"and in {more} more ways"] if more > 0 else said


def reading_notes(signals: Recordings, store: Store) -> list[str]:
    """Say what was skipped or filled in which file."""
    if not isinstance(store.decoders[signals.rows[0].modality], SignalDecoder):
        return []
    notes = [f"{row.path}: {note}." for row in signals for note in store.reading(row).notes]
    more = [f"And {len(notes) - MAX_NOTES} more such notes."] if len(notes) > MAX_NOTES else []
    return notes[:MAX_NOTES] + more


def data_facts(
    data: DataConfig, dataset: Dataset, divisions: Sequence[Folding] = ()
) -> dict[str, str]:
    """Return what the data of a run are, by heading.

    Args:
        data: Where the recordings come from.
        dataset: All that was trained or tested on.
        divisions: Division of each training.
    """
    rows = dataset.recordings
    told = {"name": data.name, "from": str(data.manifest or data.root or "")}
    told["classes"] = f"{len(rows.classes)}: {', '.join(rows.classes)}"
    for modality in dict.fromkeys(row.modality for row in rows):
        signals = rows.of(modality)
        decoder, counts = dataset.store.decoders[modality], Counter(row.label for row in signals)
        size = _spread(
            [dataset.store.extent(row) for row in signals], decoder.unit, decoder.precision
        )
        told[plural(modality)] = (
            f"{len(signals)}; {size}; {_spread([*counts.values()], '', 'd')} of a class; "
            f"{len({row.group_key for row in signals})} groups"
        )
        if read := readings(signals, dataset.store):
            told[f"{plural(modality)} read as"] = "; ".join(read)
    if divisions:
        told["folds"] = _folds(divisions)
    if dataset.skipped:
        told["left out"] = f"{len(dataset.skipped)} files that cannot be used"
    return {heading: text for heading, text in told.items() if text}
