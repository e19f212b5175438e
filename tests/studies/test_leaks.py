"""Parts of one file are the same recording as far as they overlap."""

from dataclasses import replace

import pytest

from tests.conftest import make_card
from tex_lightning.config import Folding
from tex_lightning.data.folds import split
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import FINGERPRINT_BYTES
from tex_lightning.errors import UserError
from tex_lightning.studies.leaks import refuse_leak, repeated_content, trained_on

FOLDS = Folding(folds=2, test_fold=0, inverted=False)


def rows(tmp_path, *parts: tuple[float, float] | None) -> Recordings:
    path = tmp_path / "a.wav"
    path.write_bytes(b"content")
    found = [Recording("alpha", "haptic", path, group, part=p) for group, p in enumerate(parts)]
    return Recordings(tuple(found))


def test_a_card_knows_the_parts_that_it_was_trained_on(tmp_path):
    halves = rows(tmp_path, (0, 0.5), (0.5, 1))
    card = make_card("haptic")
    card = replace(card, trained_on=trained_on(card, split(halves, FOLDS), FOLDS, None))
    assert [entry.partition("#")[2] for entry in card.trained_on["seen"]] == ["0.5-1"]
    refuse_leak(Recordings(halves.rows[:1]), card, "FILE", FOLDS)
    for part in ((0.5, 1), (0.4, 0.6), None):
        with pytest.raises(UserError, match=r"trained on 1 of the 1 test recordings, a\.wav"):
            refuse_leak(rows(tmp_path, part), card, "FILE", FOLDS)


def test_a_whole_file_is_known_in_every_part(tmp_path):
    card = make_card("haptic")
    whole = rows(tmp_path, (0, 0.1), None)
    card = replace(card, trained_on=trained_on(card, split(whole, FOLDS), FOLDS, None))
    with pytest.raises(UserError, match="trained on 1 of the 1"):
        refuse_leak(rows(tmp_path, (0.8, 0.9)), card, "FILE", FOLDS)


def test_copies_in_another_class_or_fold_are_said_by_the_names_of_two(tmp_path):
    def row(name: str, label: str, fold: int, content: bytes) -> Recording:
        (tmp_path / name).write_bytes(content)
        return Recording(label, "haptic", tmp_path / name, fold, fold=fold)

    middle = b"x" * FINGERPRINT_BYTES
    clean = [
        row("a.wav", "oak", 0, middle + b"one" + middle),
        row("b.wav", "oak", 1, middle + b"two" + middle),  # the same size and ends
        row("c.wav", "pine", 1, b"other"),
    ]
    assert not [*repeated_content(Recordings(tuple(clean)), folds=True)]
    inside = row("again.wav", "pine", 1, b"other")  # of one class and fold: nobody is misled
    assert not [*repeated_content(Recordings((*clean, inside)), folds=True)]
    copies = [row("d.wav", "ash", 1, b"other"), row("e.wav", "oak", 2, middle + b"two" + middle)]
    of_classes, of_folds = repeated_content(Recordings((*clean, *copies)), folds=True)
    assert f"{tmp_path}/c.wav and {tmp_path}/d.wav have the same content, but are of the" in (
        of_classes
    )
    assert "classes pine and ash; take one" in of_classes
    assert (
        f"{tmp_path}/b.wav and {tmp_path}/e.wav have the same content, but are in the" in of_folds
    )
    assert "folds 1 and 2, so that" in of_folds
    assert len([*repeated_content(Recordings((*clean, *copies)), folds=False)]) == 1
