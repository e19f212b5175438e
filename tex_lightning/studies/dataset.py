"""Open a data set for a training, a test or an adaptation: read, decoded and checked."""

import logging
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DataConfig, Folding
from tex_lightning.core.progress import track
from tex_lightning.data.decode import ASSUMED, SignalDecoder
from tex_lightning.data.folds import (
    Split,
    absent_classes,
    check_split,
    make_samples,
    split,
    tested_part,
)
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.readers.folder import TOO_DEEP
from tex_lightning.data.readers.layout import hint
from tex_lightning.data.readers.vocabulary import rename
from tex_lightning.data.recordings import MODALITIES, Recording, Recordings, normal_form
from tex_lightning.data.store import Store, Unusable, cache_root, list_files
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.conditions import Bins, condition_bins
from tex_lightning.learning.provenance import as_trained, is_training_data, refuse_leak
from tex_lightning.senses.base import Sense

EMPTY = Recordings(())
log = logging.getLogger(__name__)
SHOWN = 3  # parts that lack classes


@dataclass(frozen=True)
class Dataset:
    """The decoded recordings of one task.

    Attributes:
        classes: Class names in natural order.
        recordings: Recordings of the modalities that the model needs.
        unknown: Recordings of held-out classes, used only in their own test.
        store: Decoded files.
        skipped: Recordings that are left out since they cannot be used (``data.skip_bad``).
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
        """Decode all recordings, and leave out those that cannot be decoded."""
        damaged = store.fill([*recordings, *unknown])
        bad = [unusable.recording for unusable in damaged]
        known, held = recordings.without(bad), unknown.without(bad)
        return cls(classes, known, held, store, tuple(damaged))

    def usable(self, senses: Iterable[Sense], *, skip_bad: bool) -> "Dataset":
        """Leave out the recordings that are too small for a fragment of the senses that read them.

        Raises:
            UserError: Listing what was left out, unless ``skip_bad`` lets the task go on.
        """
        rows = Recordings((*self.recordings, *self.unknown))
        pairs = [(row, sense) for sense in senses for row in rows.of(sense.modality)]
        small = {}
        for row, sense in track(pairs, "checking file"):
            if unusable := self.too_small(row, sense):
                small[row] = unusable
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

    def too_small(self, row: Recording, sense: Sense) -> Unusable | None:
        """Return a recording that is too small for a sense, with the reason; else None."""
        try:
            sense.check(self.store.load(row))
        except UserError as error:
            return Unusable(row, f"{row.source}: {error}{self._assumed(row)}")
        return None

    def _assumed(self, row: Recording) -> str:
        """Return a note for a signal whose rate, and so its length, is only assumed."""
        if not isinstance(self.store.decoders[row.modality], SignalDecoder):
            return ""
        if not self.store.reading(row).rate_from.startswith(ASSUMED):
            return ""
        return (
            f" Its rate of {self.store.rate(row):,.6g} Hz is only assumed: if it is another, give "
            "data.file_rate=HZ."
        )

    def absences(self, divisions: Iterable[Folding]) -> list[str]:
        """Return a sentence that names test and validation parts without some classes, if any."""
        absent: dict[str, list[str]] = {}
        for by in divisions:
            parts = split(self.recordings, by, trains=True)
            validation = f"fold {by.val_fold}, which chooses epoch and temperature,"
            for part, name in ((parts.test, tested_part(by)), (parts.val, validation)):
                lacks = absent_classes(part, self.classes, tuple(self.store.decoders))
                if lacks and len(part):
                    absent[name] = lacks
        phrases = [f"{name} has none of {listed(lacks)}" for name, lacks in absent.items()]
        more = [f"{len(phrases) - SHOWN} more parts lack some"] if len(phrases) > SHOWN else []
        return [
            f"Not all classes are everywhere: {'; '.join([*phrases[:SHOWN], *more])}. What is "
            "measured there says nothing of them: record more groups of these classes, or take "
            "fewer folds (data.folds)."
        ][: len(phrases)]

    def parts(self, by: Folding) -> Split:
        """Return training, validation and test recordings, checked."""
        parts = split(self.recordings, by, trains=True)
        check_split(parts, self.classes, tuple(self.store.decoders), by)
        return parts


def open_dataset(data: DataConfig, senses: Sequence[Sense]) -> Dataset:
    """Read the data set to train on, and decode what the cache does not have.

    Raises:
        UserError: If the data cannot be used.
    """
    store = Store(cache_root(data.cache_dir), {sense.modality: sense.decoder for sense in senses})
    modalities = tuple(store.decoders)
    rows = read_recordings(data, modalities)
    needed = rows.of(*modalities)
    beside = of_no_sense(rows, modalities)
    if {*rows.classes} - {*needed.classes}:
        beside += hint(data.root, rows)
    needed = replace(needed, notes=(*needed.notes, *beside))
    recordings, unknown = hold_out(needed, data.hold_out)
    if len(recordings.classes) < 2:
        folders = " and ".join(f"{data.root}/CLASS/{name}" for name in modalities)
        deeper = [note for note in rows.notes if note.startswith(TOO_DEEP)]
        raise UserError(
            f"The data has {' or '.join(modalities)} recordings of "
            f"{listed(recordings.classes) or 'no class'}, and telling classes apart takes two; "
            f"choose another model, or add recordings{(data.root and f' ({folders})') or ''}."
            + "".join(f" {text}" for text in (*deeper, *beside))
        )
    dataset = Dataset.decode(recordings, unknown, store, recordings.classes)
    return replace(dataset, condition_bins=condition_bins(needed))


def of_no_sense(rows: Recordings, modalities: Sequence[str]) -> list[str]:
    """Say what the table holds beside the senses of the package and of the model."""
    others = [row for row in rows if row.modality not in {*modalities, *MODALITIES}]
    counts = Counter(row.modality for row in others)
    told = listed([f"{count} of {name}" for name, count in counts.items()])
    return [
        f"Not read, as no sense is called so: {told} (such as {row.path}).{rename(counts)}"
        for row in others[:1]
    ]


def open_test_data(
    data: DataConfig, classifier: SurfaceClassifier, who: str, *, choose: bool = False
) -> tuple[Dataset, DataConfig]:
    """Open the data set that a checkpoint is tested on.

    Only ``data.file_rate`` belongs to the files themselves and counts if it is given.

    If ``choose``, the tested part is the fold that the training left out, or all of a data set that
    the classifier was not trained on. Messages call the classifier ``who``.

    Returns:
        The test recordings, and the division that they are the test part of.

    Raises:
        UserError: If classes are unknown to the checkpoint, it was trained on these recordings, or
            they cannot be used.
    """
    card = classifier.card
    division = as_trained(data, card) if choose else data
    chosen = replace(division, test_where=data.test_where)  # other data may lack its conditions
    table = read_recordings(chosen, card.modalities, least=1)
    if choose and is_training_data(table, division, card):
        data = chosen if data.test_where else division
    rows, held = hold_out(table, data.hold_out)
    if unknown := [label for label in rows.classes if label not in card.classes]:
        raise UserError(
            f"{who} does not know the class {listed(unknown)}; leave it out of the "
            "data, name it in data.hold_out or train on it."
        )

    def tested(part: Recordings) -> Recordings:
        test = split(part.of(*card.modalities), data).test
        refuse_leak(test, card, who, data)
        return replace(test, notes=part.notes)

    dataset = decode_for(classifier, data, tested(rows), card.classes, tested(held))
    if not make_samples(dataset.recordings, card.modalities):
        raise UserError(
            f"{who} has nothing to be tested on in {tested_part(data)}; choose another "
            "data.test_fold or data.test_where, or data.test_fold=null for everything."
        )
    return replace(dataset, condition_bins=condition_bins(table.of(*card.modalities))), data


def decode_for(
    classifier: SurfaceClassifier,
    data: DataConfig,
    recordings: Recordings,
    classes: list[str],
    unknown: Recordings = EMPTY,
) -> Dataset:
    """Decode recordings as a checkpoint says, without those that it cannot use.

    Of the settings of the data only those of the cache and of the files themselves count:
    ``file_rate``, ``channels``, ``time_unit``.

    Raises:
        UserError: If files cannot be used, unless ``data.skip_bad`` leaves them out.
    """
    decoders = {
        sense.modality: sense.decoder.assuming(data.file_rate, data.channels, data.time_unit)
        for sense in classifier.senses.values()
    }
    store = Store(cache_root(data.cache_dir), decoders)
    dataset = Dataset.decode(recordings, unknown, store, classes)
    return dataset.usable(classifier.senses.values(), skip_bad=data.skip_bad)


def hold_out(recordings: Recordings, classes: list[str] | None) -> tuple[Recordings, Recordings]:
    """Divide recordings into those of known classes and those of held-out classes.

    Raises:
        UserError: If there is no such class.
    """
    held = [normal_form(label) for label in classes or ()]
    if absent := sorted({*held} - {*recordings.classes}):
        raise UserError(
            f"data.hold_out names {listed(absent)}, and the data has no such class; choose from "
            f"{listed(recordings.classes)}, with commas between names."
        )
    known = [label for label in recordings.classes if label not in held]
    return recordings.in_classes(known), recordings.in_classes(held)
