"""Provenance of weights: which recordings they were trained on, and which weights they began from.

The card of a checkpoint keeps digests of its training recordings. Testing it on one of them is a
leak and raises an error, and so does starting a training from weights that have seen its test part.
"""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, DataConfig, Folding
from tex_lightning.core.files import read_record, write_text
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.core.run_folder import holds_work
from tex_lightning.data.folds import Split, as_override, split
from tex_lightning.data.inspection import training_ranges
from tex_lightning.data.recordings import (
    Part,
    Recording,
    Recordings,
    overlap,
    read_part,
    write_part,
)
from tex_lightning.data.store import Store, fingerprint
from tex_lightning.errors import UserError
from tex_lightning_runtime.traces import axis_files

FOLD_KEYS = ("folds", "test_fold", "inverted", "val_fold")
WHERE, PER_CLASS = "test_where", "per_class"
ENDS_BYTES, ENDS_DIGITS = 65_536, 16
RECORDINGS = "recordings.json"  # in a run folder: a digest of the recordings of each modality


def complete_recipe(
    config: Config,
    card: Card,
    parts: Split,
    store: Store,
    unimodal: Mapping[str, SurfaceClassifier],
    training: dict[str, Any],
    trunk: SurfaceClassifier | None = None,
) -> Card:
    """Add to the card of a network the ranges and digests of its recordings, and its first weights.

    ``unimodal`` are the networks that FusionNet starts from, by sense; it takes their settings.
    ``training`` is what the card says of it beforehand, and ``trunk`` the network whose trunk it
    starts from.
    """
    pretrained = {name: network.card for name, network in unimodal.items()}
    ranges = {name: seen for x in pretrained.values() for name, seen in x.input_ranges.items()}
    for name in card.modalities:
        if name not in ranges:
            ranges[name] = training_ranges(parts.train.of(name), store)
    senses = {**card.senses, **{name: x.senses[name] for name, x in pretrained.items()}}
    source = None if card.baseline else config.sources.get(card.kind)
    cards = [*pretrained.values(), *([] if trunk is None else [trunk.card])]
    seen = trained_on(card, parts, config.data, cards, source)
    return replace(card, senses=senses, input_ranges=ranges, trained_on=seen, training=training)


def trained_on(
    card: Card, parts: Split, data: DataConfig, pretrained: Sequence[Card], source: str | None
) -> dict[str, Any]:
    """Return ``trained_on`` of a card: digests of the recordings, and the fold that is left out.

    Args:
        card: Card of the network to train.
        parts: Recordings by part.
        data: Division into folds.
        pretrained: Cards of the networks that it starts from, whose recordings count as its own.
        source: Source of the trunk's first weights; None is random, or that of ``pretrained``.
    """
    inverted = data.inverted and data.test_fold is not None
    used = (row for part in (parts.train, parts.val) for row in part)
    seen = digests(row for row in used if row.modality in card.modalities)
    earlier = {digest for x in pretrained for digest in x.trained_on.get("seen", ())}
    trunks = {} if source is None else {card.kind: source}
    for x in pretrained if source is None else ():
        trunks |= x.trained_on.get("trunks", {})
    return {
        "folds": data.folds,
        "test_fold": data.test_fold,
        **({"inverted": True, "val_fold": data.val_fold} if inverted else {}),
        **({WHERE: data.test_where} if data.test_where else {}),
        **({PER_CLASS: data.per_class} if data.per_class else {}),
        "seen": [*seen, *sorted(earlier.difference(seen))],
        **({"trunks": trunks} if trunks else {}),
    }


def digests(rows: Iterable[Recording]) -> list[str]:
    """Return the digest of each recording's file, followed by its part of the file, if any."""
    identities = ((fingerprint(row.path), row.part) for row in rows)
    return [
        digest if part is None else f"{digest}#{write_part(part)}" for digest, part in identities
    ]


def note_recordings(rows: Iterable[Recording], directory: Path) -> None:
    """Note in a run folder which recordings it trains and tests on.

    Its finished folds and half-trained weights are of those, and others would be pooled with them.

    Raises:
        UserError: If the run has begun with others.
    """
    facts = defaultdict(list)
    for row, digest in zip(rows := [*rows], digests(rows), strict=True):
        facts[row.modality].append(f"{row.label}\t{row.group_key}\t{row.fold}\t{digest}")
    now = {
        modality: hashlib.sha256("\n".join(sorted(lines)).encode()).hexdigest()
        for modality, lines in facts.items()
    }
    note = directory / RECORDINGS
    before = read_record(note) if note.is_file() and holds_work(directory) else {}
    if any(before.get(modality, digest) != digest for modality, digest in now.items()):
        raise UserError(
            f"The run in {directory} has begun with other recordings: some were added, changed or "
            "removed since. Choose another hydra.run.dir to train on those that there are now."
        )
    if is_rank_zero():
        write_text(note, json.dumps({**before, **now}, indent=1))


def _ends(path: Path) -> str:
    """Return the digest that checkpoints of an earlier version keep: of size, begin and end."""
    digest = hashlib.sha256()
    for file in axis_files(path):
        size = file.stat().st_size
        digest.update(str(size).encode())
        with file.open("rb") as stream:
            for start in (0, max(0, size - ENDS_BYTES)):
                stream.seek(start)
                digest.update(stream.read(ENDS_BYTES))
    return digest.hexdigest()[:ENDS_DIGITS]


def refuse_leak(test: Recordings, card: Card, who: str, data: Folding) -> None:
    """Reject weights that were trained, or chosen, on test recordings.

    Recordings are compared by the content of their files, whatever reader or folds they come from.
    Two parts of one file count as the same recording if they overlap.

    Raises:
        UserError: Naming one such file and the fold that the checkpoint was tested on.
    """
    known = seen_of(test, card)
    if not known:
        return
    leak = (
        f"{who} has trained on {len(known)} of the {len(test)} test recordings, "
        f"{known[0].path.name} among them, so testing here would flatter it; "
    )
    if trained_on_all(card):
        raise UserError(
            f"{leak}it was trained on all that there was: test it on recordings in a folder of "
            "their own. What to expect of it a cross-validation says."
        )
    theirs = {key: card.trained_on[key] for key in FOLD_KEYS if key in card.trained_on}
    where = card.trained_on.get(WHERE)
    divided = where or data.test_where  # by conditions
    if not divided and all(getattr(data, key) == value for key, value in theirs.items()):
        raise UserError(
            f"{leak}they are copies of recordings in other folds: keep one of each, or give them "
            "one group, and train anew; or task=enroll has learnt them: leave a fold out there."
        )
    same = [f"data.{key}={json.dumps(value)}" for key, value in theirs.items()]
    if divided:
        same.append(as_override(where))
    raise UserError(f"{leak}set {' '.join(same)} as in its training, or train anew.")


def seen_of(rows: Iterable[Recording], card: Card) -> list[Recording]:
    """Return the recordings that weights were trained, or chosen, on."""
    seen: dict[str, list[Part | None]] = defaultdict(list)
    for entry in card.trained_on.get("seen", ()):
        digest, _, part = entry.partition("#")
        seen[digest].append(read_part(part) if part else None)
    kinds = {fingerprint, *(_ends for digest in seen if len(digest) == ENDS_DIGITS)}
    return [
        row
        for row in rows
        if any(overlap(row.part, part) for kind in kinds for part in seen.get(kind(row.path), ()))
    ]


def trained_on_all(card: Card) -> bool:
    """Return whether a training left no recordings out for a test."""
    division = card.trained_on
    return bool(division) and division.get("test_fold") is None and not division.get(WHERE)


def as_trained(data: DataConfig, card: Card) -> DataConfig:
    """Return the settings of the data with the division that a checkpoint was trained with."""
    keys = (*FOLD_KEYS, WHERE, PER_CLASS)
    division = {key: card.trained_on[key] for key in keys if key in card.trained_on}
    reader = data.reader
    if "folds" in division and "folds" in reader:  # of a published data set, which has its own
        reader = {**reader, "folds": division["folds"]}
    return replace(data, **{"inverted": False, **division, "reader": reader})


def is_training_data(rows: Recordings, division: Folding, card: Card) -> bool:
    """Return whether a data set is that of a training: most of its training part was trained on."""
    parts = split(rows, division, trains=True)
    used = [row for row in (*parts.train, *parts.val) if row.modality in card.modalities]
    return 2 * len(seen_of(used, card)) > len(used)
