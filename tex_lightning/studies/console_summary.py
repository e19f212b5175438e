"""Print the data and settings of a task before it begins: a dozen lines on standard error."""

import logging
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from rich.text import Text

from tex_lightning.config import DataConfig, ModelConfig
from tex_lightning.config.model import FUSION
from tex_lightning.core.console import console, tell_once
from tex_lightning.data.folds import describe, is_tested, split
from tex_lightning.data.recordings import Recording, Recordings, plural
from tex_lightning.data.store import Store, Unusable, list_files
from tex_lightning.report.durations import describe_rates, mixed_rates, spread, unlike_the_others
from tex_lightning.studies.leaks import repeated_content

WIDTH, NARROWEST, INDENT = 80, 40, 10

log = logging.getLogger(__name__)


@dataclass
class Opening:
    """The data of a task; each sense is announced once, however many systems it opens.

    Attributes:
        data: Where the recordings come from.
        what: The systems that are trained or tested.
        folds: Those that networks are trained without; None where nothing is trained.
        adds: Whether the recordings are of classes that a trained network gets.
        announced: Senses that have been.
        skipped: Left-out files that have been.
    """

    data: DataConfig
    what: str
    folds: Sequence[int | None] | None = None
    adds: bool = False
    announced: set[str] = field(default_factory=set)
    skipped: set[Recording] = field(default_factory=set)

    def announce(self, recordings: Recordings, store: Store, skipped: Sequence[Unusable]) -> None:
        """Warn of what was passed over or looks wrong, and print the opening block.

        Args:
            recordings: All that will be trained or tested on, decoded.
            store: Where they are decoded.
            skipped: Files that are left out.
        """
        skipped = [each for each in skipped if each.recording not in self.skipped]
        self.skipped |= {each.recording for each in skipped}
        fresh = recordings.without(row for row in recordings if row.modality in self.announced)
        concerned: set[str | None] = set() if self.announced else {None}
        concerned |= {row.modality for row in fresh}
        for note in recordings.notes:
            if note.modality in concerned:
                log.warning("%s", note.text)
        if skipped:
            said = "\n".join([f"Going on without {len(skipped)} files:", *list_files(skipped)])
            log.warning("%s", said)
        if self.announced and not len(fresh):
            return
        self.announced |= {row.modality for row in recordings}
        for modality in {row.modality: None for row in fresh}:
            for warn in (unlike_the_others, mixed_rates):
                if odd := warn(fresh.of(modality), store):
                    log.warning("%s", odd)
        for sentence in repeated_content(fresh, folds=self.folds is not None):
            log.warning("%s", sentence)
        tell_once("\n".join(self.lines(fresh, store, skipped)))

    def lines(self, recordings: Recordings, store: Store, skipped: Sequence[Unusable]) -> list[str]:
        """The block as lines of at most 80 columns."""
        entries = [("Data", _source(self.data), 1), ("Classes", _classes(recordings), 2)]
        modalities = {row.modality: None for row in recordings}
        for modality in modalities:
            title = plural(modality).partition(" ")[0].capitalize()
            entries.append((title, _sense(recordings.of(modality), store), 1))
        for modality in modalities:
            if described := describe_rates(recordings.of(modality), store):
                entries.append(("Rates", described, 2))
        entries.append(("Folds", self._folds(recordings), 1))
        if left_out := _left_out(recordings, skipped):
            entries.append(("Skipped", left_out, 2))
        verb = "Adds to" if self.adds else "Tests" if self.folds is None else "Trains"
        entries.append((verb, self.what, 2))
        return [line for entry in entries for line in _wrapped(*entry)]

    def _folds(self, recordings: Recordings) -> str:
        data = self.data
        if self.folds is None:
            return f"{len(recordings)} recordings are {'learnt from' if self.adds else 'tested'}"
        known = recordings.without(row for row in recordings if row.label in (data.hold_out or ()))
        parts = [split(known, replace(data, test_fold=fold)) for fold in self.folds]
        train, val, test = (
            spread([len(getattr(part, name)) for part in parts], "", "d")
            for name in ("train", "val", "test")
        )
        several = len(self.folds) > 1
        which = f"each of {len(self.folds)} folds" if several else f"fold {self.folds[0]}"
        which = f"{which} of {data.folds}"
        if data.test_where is not None:
            by_fold = any(is_tested(row, data.test_where) is None for row in known)
            which = describe(data.test_where) + (f", else {which}" if by_fold else "")
        watched = f", {val} validate (fold {data.val_fold})" if data.val_fold is not None else ""
        return f"{train} recordings train{watched}, {test} test ({which})"


def trained_networks(model: ModelConfig) -> str:
    """What training a model trains, for :attr:`Opening.what`."""
    if model.baseline is not None or model.kind != FUSION:
        return model.name
    return f"{model.name}: {', '.join(model.trained)}"


def _wrapped(title: str, text: str, lines: int) -> list[str]:
    whole = " ".join(_end(word, _room()) for word in text.split())
    wrapped = [line.plain.rstrip() for line in Text(whole).wrap(console, _room())]
    last = Text(" ".join(wrapped[lines - 1 :]))
    last.truncate(_room(), overflow="ellipsis")
    shown = [*wrapped[: lines - 1], *filter(None, [last.plain])]
    titles = [title, *[""] * (len(shown) - 1)]
    return [f"{name:<{INDENT}}{line}" for name, line in zip(titles, shown, strict=True)]


def _room() -> int:
    """Columns behind the titles."""
    return min(WIDTH, max(console.width, NARROWEST)) - INDENT


def _source(data: DataConfig) -> str:
    where = data.manifest or data.root
    if where is None:
        return data.name
    return f"{data.name} {_end(str(Path(where).expanduser()), _room() - len(data.name) - 1)}"


def _end(path: str, room: int) -> str:
    """A path that is too long by its end, which says most."""
    return path if len(path) <= room else f"…{path[1 - room :]}"


def _classes(recordings: Recordings) -> str:
    return f"{len(recordings.classes)}: {', '.join(recordings.classes)}"


def _sense(rows: Recordings, store: Store) -> str:
    """How many there are, how long or large they are once decoded, and how many of each class."""
    decoder = store.decoders[rows.rows[0].modality]
    sizes = [store.extent(row) for row in rows]
    size = spread(sizes, decoder.unit, decoder.precision, median=True)
    counts = Counter(row.label for row in rows)
    each = f"{len(rows)}; {size}; {spread(list(counts.values()), '', 'd')} of a class"
    if len(set(counts.values())) == 1:
        return each
    return f"{each} (fewest: {min(counts, key=lambda label: counts[label])})"


def _left_out(recordings: Recordings, skipped: Sequence[Unusable]) -> str:
    counts = Counter[str]()
    for note in recordings.notes:
        if note.count:
            counts[note.what] += note.count
    if skipped:
        counts["unusable file"] = len(skipped)
    listed = ", ".join(f"{count} x {what}" for what, count in counts.items())
    return f"{listed} (why: see above)" if counts else ""
