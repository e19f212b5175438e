"""Record the training recordings in a checkpoint, and refuse to test on them."""

import filecmp
import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from tex_lightning.classifier.card import Card
from tex_lightning.config import DataConfig, Folding
from tex_lightning.data.folds import Split, as_override
from tex_lightning.data.recordings import (
    Part,
    Recording,
    Recordings,
    overlap,
    read_part,
    write_part,
)
from tex_lightning.data.store import fingerprint
from tex_lightning.data.traces import axis_files
from tex_lightning.errors import UserError
from tex_lightning.learning.start import name_source, starting_classifier

FOLD_KEYS = ("folds", "test_fold", "inverted", "val_fold")
WHERE = "test_where"


def trained_on(card: Card, parts: Split, data: DataConfig, source: str | None) -> dict[str, Any]:
    """Digests of the recordings that one network is trained on, and the fold that is left out.

    Args:
        card: Card of the network to train.
        parts: Recordings by part.
        data: How they were divided.
        source: Where the trunk starts; None is at random.

    Raises:
        UserError: If the trunk cannot be used or has seen what is to be tested.
    """
    if source is None:
        return _seen(card, parts, data)
    start = starting_classifier(source, card)
    begun = {} if start is None else start.card.trained_on
    if start is not None:
        test = parts.test.of(card.modalities[0])
        refuse_leak(test, start.card, f"weights: checkpoint {source}", data)
    return {**_seen(card, parts, data, begun), "trunks": {card.kind: name_source(source)}}


def trained_on_parts(card: Card, parts: Split, data: DataConfig, *starts: Card) -> dict[str, Any]:
    """Digests for a FusionNet that starts from networks with the cards ``starts``."""
    begun = [start.trained_on for start in starts]
    trunks = {kind: name for each in begun for kind, name in each.get("trunks", {}).items()}
    return {**_seen(card, parts, data, *begun), **({"trunks": trunks} if trunks else {})}


def _seen(card: Card, parts: Split, data: DataConfig, *begun: dict[str, Any]) -> dict[str, Any]:
    used = (row for part in (parts.train, parts.val) for row in part)
    seen = digests(row for row in used if row.modality in card.modalities)
    earlier = {digest for each in begun for digest in each.get("seen", ())}
    return {
        "folds": data.folds,
        "test_fold": data.test_fold,
        **({"inverted": True, "val_fold": data.val_fold} if data.inverted else {}),
        **({WHERE: data.test_where} if data.test_where else {}),
        "seen": [*seen, *sorted(earlier.difference(seen))],
    }


def digests(rows: Iterable[Recording]) -> list[str]:
    """Digest of each recording: that of its file's content, and its part of the file."""
    found = ((fingerprint(row.path), row.part) for row in rows)
    return [digest if part is None else f"{digest}#{write_part(part)}" for digest, part in found]


def repeated_content(recordings: Recordings, *, folds: bool) -> Iterator[str]:
    """Say which files have the same content but not the same class, or not the same fold.

    Args:
        recordings: Recordings with folds.
        folds: Whether folds are trained and tested on.

    Yields:
        A sentence on classes and one on folds, as far as there are such files.
    """
    pairs = list(_same_content(recordings))
    of_classes = [pair for pair in pairs if pair[0].label != pair[1].label]
    of_folds = [pair for pair in pairs if pair[0].label == pair[1].label and folds]
    if of_classes:
        one, other = of_classes[0]
        yield (
            f"{one.path} and {other.path} have the same content, but are of the classes "
            f"{one.label} and {other.label}{_more(of_classes)}; take one of them out."
        )
    if of_folds:
        one, other = of_folds[0]
        yield (
            f"{one.path} and {other.path} have the same content, but are in the folds {one.fold} "
            f"and {other.fold}{_more(of_folds)}, so that one tests what the other trains; take "
            "one of them out, or give both one group."
        )


def _more(pairs: Sequence[object]) -> str:
    return f" (and {len(pairs) - 1} more pairs)" if len(pairs) > 1 else ""


def _same_content(recordings: Recordings) -> Iterator[tuple[Recording, Recording]]:
    """Pairs of different files, byte for byte the same, that differ in class or fold."""
    alike: dict[tuple[str, int], list[Recording]] = defaultdict(list)
    for row in recordings:
        alike[row.modality, axis_files(row.path)[0].stat().st_size].append(row)
    for rows in alike.values():
        if len({row.path for row in rows}) < 2:
            continue
        first: dict[str, list[Recording]] = defaultdict(list)
        for row in rows:
            known = first[fingerprint(row.path)]
            other = next((each for each in known if _is_copy(each, row)), None)
            if other is not None:
                yield other, row
            known.append(row)


def _is_copy(one: Recording, other: Recording) -> bool:
    apart = (one.label, one.fold) != (other.label, other.fold)
    if one.path == other.path or not apart or not overlap(one.part, other.part):
        return False
    files = zip(axis_files(one.path), axis_files(other.path), strict=False)
    return all(filecmp.cmp(*pair, shallow=False) for pair in files)


def refuse_leak(test: Recordings, card: Card, who: str, data: Folding) -> None:
    """Refuse weights that were trained, or chosen, on test recordings.

    Recordings are compared by content, so that neither another reader nor other folds hide one; two
    parts of one file are the same as far as they overlap.

    Args:
        test: What is to be tested.
        card: Card of the checkpoint.
        who: Its name in the message.
        data: How this run was told what to test.

    Raises:
        UserError: Naming one such file and the fold that the checkpoint was tested on.
    """
    seen: dict[str, list[Part | None]] = defaultdict(list)
    for entry in card.trained_on["seen"]:
        digest, _, part = entry.partition("#")
        seen[digest].append(read_part(part) if part else None)
    known = [
        row
        for row in test
        if any(overlap(row.part, part) for part in seen.get(fingerprint(row.path), ()))
    ]
    if known:
        theirs = card.trained_on.get(WHERE)
        same = " ".join(
            [
                *(
                    f"data.{key}={json.dumps(value)}"
                    for key, value in card.trained_on.items()
                    if key in FOLD_KEYS
                ),
                *([as_override(theirs)] if theirs or data.test_where else []),
            ]
        )
        raise UserError(
            f"{who} has trained on {len(known)} of the {len(test)} test recordings, "
            f"{known[0].path.name} among them, so testing here would flatter it; set "
            f"{same} as in its training, or train anew."
        )
