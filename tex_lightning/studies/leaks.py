"""Record the training recordings in a checkpoint, and raise an error when they are tested."""

import hashlib
import json
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
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

FOLD_KEYS = ("folds", "test_fold", "inverted", "val_fold")
WHERE = "test_where"
ENDS_BYTES, ENDS_DIGITS = 65_536, 16


def trained_on(
    card: Card, parts: Split, data: DataConfig, begun: Sequence[Card], source: str | None
) -> dict[str, Any]:
    """Return digests of the recordings that a network is trained on, and the fold that is left out.

    Args:
        card: Card of the network to train.
        parts: Recordings by part.
        data: Division into folds.
        begun: Cards of the networks that it starts from; it has seen what they have.
        source: Where its trunk starts; None is at random, or as in ``begun``.
    """
    used = (row for part in (parts.train, parts.val) for row in part)
    seen = digests(row for row in used if row.modality in card.modalities)
    earlier = {digest for start in begun for digest in start.trained_on.get("seen", ())}
    trunks = {} if source is None else {card.kind: source}
    for start in begun if source is None else ():
        trunks |= start.trained_on.get("trunks", {})
    return {
        "folds": data.folds,
        "test_fold": data.test_fold,
        **({"inverted": True, "val_fold": data.val_fold} if data.inverted else {}),
        **({WHERE: data.test_where} if data.test_where else {}),
        "seen": [*seen, *sorted(earlier.difference(seen))],
        **({"trunks": trunks} if trunks else {}),
    }


def digests(rows: Iterable[Recording]) -> list[str]:
    """Return digest of each recording: that of its file's content, and its part of the file."""
    identities = ((fingerprint(row.path), row.part) for row in rows)
    return [
        digest if part is None else f"{digest}#{write_part(part)}" for digest, part in identities
    ]


def _ends(path: Path) -> str:
    """Return the digest of size and ends that earlier checkpoints keep instead."""
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

    Recordings are compared by content, so that neither another reader nor other folds hide one; two
    parts of one file are the same as far as they overlap.

    Args:
        test: Test recordings.
        card: Card of the checkpoint.
        who: Name of the checkpoint in the message.
        data: Division into folds or by condition.

    Raises:
        UserError: Naming one such file and the fold that the checkpoint was tested on.
    """
    seen: dict[str, list[Part | None]] = defaultdict(list)
    for entry in card.trained_on["seen"]:
        digest, _, part = entry.partition("#")
        seen[digest].append(read_part(part) if part else None)
    kinds = {fingerprint, *(_ends for digest in seen if len(digest) == ENDS_DIGITS)}
    known = [
        row
        for row in test
        if any(overlap(row.part, part) for kind in kinds for part in seen.get(kind(row.path), ()))
    ]
    if known:
        theirs = {key: card.trained_on[key] for key in FOLD_KEYS if key in card.trained_on}
        same = [f"data.{key}={json.dumps(value)}" for key, value in theirs.items()]
        if (where := card.trained_on.get(WHERE)) or data.test_where:
            same.append(as_override(where))
        raise UserError(
            f"{who} has trained on {len(known)} of the {len(test)} test recordings, "
            f"{known[0].path.name} among them, so testing here would flatter it; set "
            f"{' '.join(same)} as in its training, or train anew."
        )
