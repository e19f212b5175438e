"""Parts of one file are the same recording as far as they overlap."""

from dataclasses import replace

import pytest

from tests.conftest import make_card
from tex_lightning.config import Folding
from tex_lightning.data.folds import split
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError
from tex_lightning.studies.leaks import refuse_leak, trained_on

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
    for part in ((0.5, 1), (0.4, 0.6), None):
        with pytest.raises(UserError, match=r"trained on 1 of the 1 test recordings, a\.wav"):
            refuse_leak(rows(tmp_path, part), card, "FILE", FOLDS)


def test_a_whole_file_is_known_in_every_part(tmp_path):
    card = make_card("haptic")
    whole = rows(tmp_path, (0, 0.1), None)
    card = replace(card, trained_on=trained_on(card, split(whole, FOLDS), FOLDS, [], None))
    with pytest.raises(UserError, match="trained on 1 of the 1"):
        refuse_leak(rows(tmp_path, (0.8, 0.9)), card, "FILE", FOLDS)
