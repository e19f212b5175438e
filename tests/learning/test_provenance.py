"""Parts of one file are the same recording as far as they overlap."""

import os
from dataclasses import replace

import pytest
from conftest import make_card

from tex_lightning.config import Folding
from tex_lightning.data.folds import split
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import fingerprint
from tex_lightning.errors import UserError
from tex_lightning.learning.provenance import _ends, digests, refuse_leak, trained_on

FOLDS = Folding(folds=2, test_fold=0, inverted=False)


def rows(tmp_path, *parts: tuple[float, float] | None) -> Recordings:
    path = tmp_path / "a.wav"
    path.write_bytes(b"content")
    found = [Recording("alpha", "haptic", path, group, part=p) for group, p in enumerate(parts)]
    return Recordings(tuple(found))


def test_a_card_knows_the_parts_that_it_was_trained_on(tmp_path):
    halves = rows(tmp_path, (0, 0.5), (0.5, 1))
    card = make_card("haptic")
    card = replace(card, trained_on=trained_on(card, split(halves, FOLDS), FOLDS, [], None))
    assert [entry.partition("#")[2] for entry in card.trained_on["seen"]] == ["0.5-1"]
    refuse_leak(Recordings(halves.rows[:1]), card, "FILE", FOLDS)
    with pytest.raises(UserError, match=r"set data\.folds=2 data\.test_fold=0 as in its"):
        refuse_leak(Recordings(halves.rows[1:]), card, "FILE", replace(FOLDS, test_fold=1))
    for part in ((0.5, 1), (0.4, 0.6), None):
        copied = r"trained on 1 of the 1 test recordings, a\.wav .* copies .* keep one of each"
        with pytest.raises(UserError, match=copied):  # no other fold would help
            refuse_leak(rows(tmp_path, part), card, "FILE", FOLDS)


@pytest.mark.parametrize("digits", [32, 16])
def test_files_that_begin_and_end_alike_are_different_recordings(tmp_path, digits):
    """Gated signals begin and end in silence; checkpoints of before knew no more than the ends."""
    silence = bytes(1 << 17)
    files = [tmp_path / f"{kind}.wav" for kind in range(3)]
    for kind, file in enumerate(files):
        file.write_bytes(silence + bytes([kind]) + silence)
    table = Recordings(tuple(Recording("a", "haptic", file, n) for n, file in enumerate(files)))
    assert len({*digests(table)}) == 3
    seen = digests(table.rows[1:]) if digits == 32 else [_ends(files[1])]
    assert {len(digest) for digest in seen} == {digits}
    card = replace(make_card("haptic"), trained_on={"seen": seen, "folds": 2, "test_fold": 0})
    if digits == 32:
        refuse_leak(Recordings(table.rows[:1]), card, "FILE", FOLDS)
    with pytest.raises(UserError, match="trained on 1 of the 1"):
        refuse_leak(Recordings(table.rows[1:2]), card, "FILE", FOLDS)


def test_the_digest_is_that_of_the_file_as_it_is_now(tmp_path):
    one, other = tmp_path / "1.wav", tmp_path / "2.wav"
    one.write_bytes(bytes(1 << 17) + b"a" + bytes(1 << 17))
    other.write_bytes(bytes(1 << 17) + b"b" + bytes(1 << 17))
    for file in (one, other):
        os.utime(file, ns=(1, 1))  # as unpacked from an archive
    before = fingerprint(one)
    other.replace(one)
    assert fingerprint(one) != before


def test_a_whole_file_is_known_in_every_part(tmp_path):
    card = make_card("haptic")
    whole = rows(tmp_path, (0, 0.1), None)
    card = replace(card, trained_on=trained_on(card, split(whole, FOLDS), FOLDS, [], None))
    with pytest.raises(UserError, match="trained on 1 of the 1"):
        refuse_leak(rows(tmp_path, (0.8, 0.9)), card, "FILE", FOLDS)
