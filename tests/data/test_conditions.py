from pathlib import Path

import pytest

from tex_lightning.config import Folding
from tex_lightning.data.folds import (
    check_conditions,
    check_split,
    split,
)
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError


def trace(number: int, label: str = "a", **conditions: str) -> Recording:
    path = Path(f"{label}{number}.wav")
    return Recording(label, "haptic", path, number, None, tuple(conditions.items()))


def photo(number: int, label: str = "a", **conditions: str) -> Recording:
    path = Path(f"{label}{number}.jpg")
    return Recording(label, "image", path, number, None, tuple(conditions.items()))


def by(where: object, test_fold: int | None = 0, val_fold: int | None = None) -> Folding:
    return Folding(5, test_fold, val_fold, False, None, where)


def names(part: Recordings) -> list[str]:
    return [row.path.name for row in part]


STROKES = Recordings(
    tuple(
        trace(n, speed=speed, light=light, wet=["true", "True", "false"][min(n, 2)])
        for n, (speed, light) in enumerate(
            [("60", "lamp"), ("60.0", "sun"), ("50", "lamp"), ("6", "sun"), ("fast", "lamp")]
        )
    )
)


@pytest.mark.parametrize(
    ("where", "tested"),
    [
        ({"speed": 60}, [0, 1]),
        ({"speed": "60"}, [0, 1]),
        ({"speed": 60.0, "light": "lamp"}, [0]),
        ({"speed": [50, 60]}, [0, 1, 2]),
        ({"speed": ["fast", 6], "light": ["lamp"]}, [4]),
        ({"light": "sun"}, [1, 3]),
        ({"wet": True}, [0, 1]),
    ],
)
def test_all_conditions_must_hold_and_numbers_are_compared_by_size(where, tested):
    parts = split(STROKES, by(where))
    assert names(parts.test) == [f"a{n}.wav" for n in tested]
    assert names(parts.train) == [f"a{n}.wav" for n in range(5) if n not in tested]


def test_a_sense_without_the_condition_is_divided_by_folds():
    rows = Recordings((*STROKES, *(photo(n) for n in range(5))))
    parts = split(rows, by({"speed": 60}, test_fold=3, val_fold=4))
    assert names(parts.test) == ["a0.wav", "a1.wav", "a3.jpg"]
    assert names(parts.val) == ["a4.wav", "a4.jpg"]
    everything = split(rows, by({"speed": 60}, test_fold=None))
    assert names(everything.test) == ["a0.wav", "a1.wav", *(f"a{n}.jpg" for n in range(5))]


@pytest.mark.parametrize(
    ("where", "message"),
    [
        (
            {"sped": 60},
            r"no recording has sped 60 \(did you mean speed\?\); choose from speed",
        ),
        ({"speed": 61}, r"no recording has speed 61 \(did you mean 6.*choose from 6, 50, 60.*fast"),
        ({"light": ["lamp", "lmp"]}, r"has light lmp \(did you mean lamp\?\)"),
    ],
)
def test_unknown_conditions_and_values_are_named_with_near_ones(where, message):
    with pytest.raises(UserError, match=message):
        check_conditions(STROKES, where)


def test_a_condition_that_some_of_a_sense_do_not_say_is_refused():
    rows = Recordings((*STROKES, trace(5, light="lamp"), photo(0)))
    with pytest.raises(UserError, match=r"speed, which 1 of the 7 .* do not say, a5\.wav for one"):
        check_conditions(rows, {"speed": 60})
    check_conditions(Recordings((*STROKES, photo(0))), {"speed": 60})


def test_conditions_that_leave_nothing_to_train_or_test_are_said():
    rows = Recordings((trace(0, speed="1"), trace(1, "b", speed="1"), trace(2, "b", speed="2")))
    for where, message in (
        ({"speed": 1}, "no traces to train on for a; .* test less"),
        (
            {"speed": 3},
            "The part with speed 3 holds nothing to test on .* or data.test_where",
        ),
    ):
        with pytest.raises(UserError, match=message):
            check_split(split(rows, by(where)), ["a", "b"], ["haptic"], by(where))
