from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.config import Folding
from tex_lightning.data.folds import (
    absent_classes,
    check_conditions,
    check_split,
    comparable,
    count_folds,
    make_samples,
    split,
    with_folds,
)
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError


def table(**counts: tuple[int, int]) -> Recordings:
    """Classes with so many traces and photos."""
    rows = []
    for label, (traces, photos) in counts.items():
        rows += [Recording(label, "haptic", Path(f"{label}{i}.wav"), i) for i in range(traces)]
        rows += [Recording(label, "image", Path(f"{label}{i}.jpg"), i) for i in range(photos)]
    return Recordings(tuple(rows))


def by(
    folds: int,
    test_fold: int | None,
    val_fold: int | None = None,
    inverted: bool = False,
    per_class: int | None = None,
) -> Folding:
    return Folding(folds, test_fold, val_fold, inverted, per_class)


@given(folds=st.integers(2, 12), groups=st.lists(st.integers(0, 99), min_size=1, max_size=40))
def test_every_recording_is_tested_once_and_never_with_its_group_in_training(folds, groups):
    rows = Recordings(tuple(Recording("a", "haptic", Path(), group) for group in groups))
    tested = 0
    for fold in range(folds):
        parts = split(rows, by(folds, fold, (fold + 1) % folds))
        assert len(parts.train) + len(parts.val) + len(parts.test) == len(rows)
        tested += len(parts.test)
        groups_of = [{row.group for row in part} for part in (parts.train, parts.val, parts.test)]
        assert sum(map(len, groups_of)) == len(set.union(*groups_of))
    assert tested == len(rows)


@pytest.mark.parametrize("numbers", [range(5), [0, 2, 4, 6, 8], [0, 10, 20, 30, 40]])
def test_ten_folds_of_five_groups_are_five(numbers):
    numbered = Recordings(tuple(Recording("a", "haptic", Path(), number) for number in numbers))
    named = Recordings(tuple(replace(row, group=f"day {row.group}") for row in numbered))
    for rows in (numbered, named):
        asked, fitting = (with_folds(rows, folds) for folds in (10, 5))
        assert count_folds(asked) == 5
        assert sorted(row.fold for row in asked) == [0, 1, 2, 3, 4]
        assert [row.fold for row in asked] == [row.fold for row in fitting]


@given(
    groups=st.lists(
        st.tuples(st.sampled_from("abc"), st.sampled_from(("haptic", "image")), st.integers(0, 15)),
        min_size=2, max_size=60,
    ),
    folds=st.integers(2, 10),
    shared=st.booleans(),
)  # fmt: skip
def test_named_groups_stay_together_across_modalities_and_no_fold_is_empty(groups, folds, shared):
    rows = tuple(
        Recording(label, modality, Path(str(at)), f"{'' if shared else label}{number} s")
        for at, (label, modality, number) in enumerate(groups)
    )
    found = with_folds(Recordings(rows), folds)
    assert len({(row.group, row.fold) for row in found}) == len({row.group for row in found})
    if len({row.group for row in found}) > 1:
        assert {row.fold for row in found} == set(range(count_folds(found)))
    turned = with_folds(Recordings(rows[::-1]), folds)
    assert [row.fold for row in turned][::-1] == [row.fold for row in found]  # no chance, no order


def test_inverted_swaps_training_and_test_and_leaves_validation_out_of_both():
    rows = table(a=(8, 0), b=(8, 0))
    plain, turned = (split(rows, by(4, 2, 1, inverted)) for inverted in (False, True))
    assert (turned.train, turned.val, turned.test) == (plain.test, plain.val, plain.train)
    assert {row.group % 4 for row in turned.train} == {2}  # in natural order, modulo the folds


@pytest.mark.parametrize("name", [int, str, "take {}".format, "{:04}".format])
@pytest.mark.parametrize("strokes", [10, 4])
def test_strokes_numbered_in_the_order_of_recording_give_folds_of_all_classes(name, strokes):
    """One class after the other, counted through: the folds were of one class each."""
    rows = [
        Recording(label, "haptic", Path(f"{label}{n}"), name(kind * strokes + n))
        for kind, label in enumerate("abcde")
        for n in range(strokes)
    ]
    found = with_folds(Recordings(tuple(rows)), 10)
    assert count_folds(found) == strokes
    by_fold = Counter((row.fold, row.label) for row in found)
    assert by_fold == {(fold, label): 1 for fold in range(strokes) for label in "abcde"}


@given(
    rows=st.lists(st.tuples(st.sampled_from("abc"), st.integers(0, 30)), min_size=2, max_size=60),
    folds=st.integers(2, 10),
)
def test_numbers_and_text_are_groups_alike(rows, folds):
    numbered = [Recording(label, "haptic", Path(), number) for label, number in rows]
    named = [replace(row, group=f"session {row.group}") for row in numbered]
    found = [with_folds(Recordings(tuple(each)), folds) for each in (numbered, named)]
    assert [row.fold for row in found[0]] == [row.fold for row in found[1]]
    assert len({(row.group, row.fold) for row in found[0]}) == len({row.group for row in found[0]})


def test_ten_strokes_and_forty_photos_keep_their_documented_folds():
    rows = with_folds(table(a=(10, 40), b=(10, 40), c=(10, 40)), 10)
    assert [row.fold for row in rows] == [row.group % 10 for row in rows]


def test_classes_that_a_part_lacks_are_those_without_a_whole_sample():
    rows = table(a=(1, 1), b=(1, 0), c=(0, 1))
    assert absent_classes(rows, "abcd", ("haptic", "image")) == ["b", "c", "d"]
    assert absent_classes(rows, "abcd", ("image",)) == ["b", "d"]


@given(folds=st.integers(2, 10), fold=st.integers(0, 9), count=st.integers(1, 12))
def test_few_of_each_class_and_sense_are_trained_on_whatever_is_tested(folds, fold, count):
    rows = table(a=(20, 7), b=(3, 40))
    whole, few = (split(rows, by(folds, fold % folds, None, False, k)) for k in (None, count))
    assert few.test == whole.test
    for label, modality in [(x, y) for x in "ab" for y in ("haptic", "image")]:
        there = len(whole.train.in_classes([label]).of(modality))
        assert len(few.train.in_classes([label]).of(modality)) == min(count, there)
    assert set(few.train) <= set(whole.train)


def test_every_fold_draws_other_recordings():
    rows = table(a=(10, 0))
    drawn = [[row.group for row in split(rows, by(10, n, None, False, 2)).train] for n in range(10)]
    assert sorted(group for groups in drawn for group in groups) == sorted([*range(10)] * 2)
    assert drawn[0] == [1, 2]
    assert drawn[9] == [0, 1]


def test_samples_of_three_modalities_have_a_recording_of_each():
    rows = table(a=(2, 3), b=(1, 1))
    sounds = [Recording("a", "sound", Path(f"s{i}.wav"), i) for i in range(5)]
    samples = make_samples(Recordings((*rows, *sounds)), ("sound", "image", "haptic"))
    assert {sample.label for sample in samples} == {"a"}  # b has no sounds
    found = [[row.path.name for row in sample.recordings.values()] for sample in samples]
    assert found == [[f"s{i}.wav", f"a{i % 3}.jpg", f"a{i % 2}.wav"] for i in range(5)]
    with pytest.raises(UserError, match="no sound recordings to train on for b"):
        check_split(split(rows, by(2, None, None)), ["b"], ["sound"], by(2, None, None))


def trace(number: int, label: str = "a", **conditions: str) -> Recording:
    path = Path(f"{label}{number}.wav")
    return Recording(label, "haptic", path, number, None, tuple(conditions.items()))


def where_is(where: object, test_fold: int | None = 0, val_fold: int | None = None) -> Folding:
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
    parts = split(STROKES, where_is(where))
    assert names(parts.test) == [f"a{n}.wav" for n in tested]
    assert names(parts.train) == [f"a{n}.wav" for n in range(5) if n not in tested]


@pytest.mark.parametrize("inverted", [False, True])
def test_without_a_test_fold_a_training_sees_all_and_a_test_tests_all(inverted):
    rows = table(a=(5, 0), b=(5, 0))
    for val, chosen in ((None, 0), (3, 2)):
        by = Folding(5, None, val, inverted)
        parts = split(rows, by, trains=True)
        assert (len(parts.train), len(parts.val), len(parts.test)) == (10 - chosen, chosen, 0)
        check_split(parts, ["a", "b"], ["haptic"], by)
        assert len(split(rows, by).test) == 10
    where = where_is({"speed": 60}, test_fold=None)
    assert names(split(STROKES, where, trains=True).test) == ["a0.wav", "a1.wav"]


def test_a_sense_without_the_condition_is_divided_by_folds():
    rows = Recordings((*STROKES, *table(a=(0, 5))))
    parts = split(rows, where_is({"speed": 60}, test_fold=3, val_fold=4))
    assert names(parts.test) == ["a0.wav", "a1.wav", "a3.jpg"]
    assert names(parts.val) == ["a4.wav", "a4.jpg"]
    everything = split(rows, where_is({"speed": 60}, test_fold=None))
    assert names(everything.test) == ["a0.wav", "a1.wav", *(f"a{n}.jpg" for n in range(5))]


@pytest.mark.parametrize(
    ("where", "message"),
    [
        ({"sped": 60}, r"no recording has sped 60 \(did you mean speed\?\); choose from speed"),
        ({"speed": 61}, r"no recording has speed 61 \(did you mean 6.*choose from 6, 50, 60.*fast"),
        ({"light": ["lamp", "lmp"]}, r"has light lmp \(did you mean lamp\?\)"),
    ],
)
def test_unknown_conditions_and_values_are_named_with_near_ones(where, message):
    with pytest.raises(UserError, match=message):
        check_conditions(STROKES, where)


def test_a_condition_that_some_of_a_sense_do_not_say_is_refused():
    rows = Recordings((*STROKES, trace(5, light="lamp"), *table(a=(0, 1))))
    with pytest.raises(UserError, match=r"speed, which 1 of the 7 .* do not say, a5\.wav for one"):
        check_conditions(rows, {"speed": 60})
    check_conditions(Recordings((*STROKES, *table(a=(0, 1)))), {"speed": 60})


def test_conditions_that_leave_nothing_to_train_or_test_are_said():
    rows = Recordings((trace(0, speed="1"), trace(1, "b", speed="1"), trace(2, "b", speed="2")))
    for where, message in (
        ({"speed": 1}, "no traces to train on for a, which are all of the group 0; .* test less"),
        (
            {"speed": 3},
            "The part with speed 3 holds nothing to test on .* or data.test_where",
        ),
    ):
        with pytest.raises(UserError, match=message):
            check_split(split(rows, where_is(where)), ["a", "b"], ["haptic"], where_is(where))


def test_classes_of_one_group_are_said_to_be_of_it():
    rows = Recordings(tuple(replace(trace(n, label), group="s1") for n in (0, 1) for label in "ab"))
    with pytest.raises(UserError, match="train on for a, b, which are all of the group s1; add"):
        check_split(split(rows, by(2, 0, None)), ["a", "b"], ["haptic"], by(2, 0, None))


def test_conditions_that_may_be_names_are_compared_as_text_and_decimal_numbers_as_numbers():
    for one, other in [(60, "60.0"), ("-0.50", "-.5"), (True, "true"), ("+5", 5), ("0", 0.0)]:
        assert comparable(one) == comparable(other)
    names = ["007", "7", "1_0", "10", "1e3", "1000", "nan", "2024_05_01", "20240501"]
    assert len({*map(comparable, names)}) == len(names)
