"""Share, estimate and text of the progress line, on levels that are made up."""

import io
import time
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from tex_lightning.progress_line import (
    Level,
    describe,
    format_seconds,
    line,
    seconds_left,
    sentence,
    share,
)

LONG = "a_system_with_a_name_that_goes_on_and_on_and_on_for_ever"


def shown(levels: list[Level], width: int) -> list[str]:
    console = Console(file=io.StringIO(), width=width, color_system=None)
    console.print(line(levels, width))
    return console.file.getvalue().splitlines()


def training(epoch: float = 3) -> list[Level]:
    notes = ["loss 0.123", "val 0.456", "votes 100%"]
    return [Level("fold", 10, 2), Level("haptic", 3, 1), Level("epoch", 40, epoch, notes=notes)]


def test_nested_levels_share_one_bar():
    assert share(training(20)) == pytest.approx((2 + (1 + 20 / 40) / 3) / 10)


def test_what_is_not_counted_moves_the_bar_only_where_it_is_alone():
    test = Level("Testing", 4, 1, counted=False)
    assert share([test]) == 1 / 4
    assert share([Level("fold", 10, 2), test]) == 2 / 10


@given(st.lists(st.integers(1, 5), min_size=1, max_size=3))
def test_the_share_of_nested_work_never_falls_and_ends_at_one(totals):
    shares, levels = [], []

    def work(depth: int) -> None:
        level = Level("level", totals[depth])
        levels.append(level)
        for number in range(totals[depth]):
            level.done, level.partly = number, 0.0
            shares.append(share(levels))
            if depth + 1 < len(totals):
                work(depth + 1)
            shares.append(share(levels))
        level.done, level.partly = totals[depth], 0.0
        shares.append(share(levels))
        if depth:
            levels.pop()
            levels[-1].partly = share([level])

    work(0)
    assert all(after >= before - 1e-12 for before, after in pairwise(shares))
    assert shares[-1] == pytest.approx(1)


def test_the_estimate_is_of_this_run_alone(monkeypatch):
    fold = Level("fold", 10, 4)  # which an earlier run has done
    fold.done = 7
    monkeypatch.setattr(time, "monotonic", lambda: fold.begun + 30)
    assert seconds_left([fold]) == pytest.approx(3 * 10)
    assert seconds_left([Level("fold", 10)]) is None
    assert seconds_left([Level("system", 3, 1, seconds_left=lambda: 12.0)]) == 12
    assert sentence([fold]) == "70 % done, about 30 s left: fold 8/10."


@pytest.mark.parametrize("width", [20, 30, 40, 60, 79, 80, 120])
@pytest.mark.parametrize("title", ["haptic", LONG])
def test_the_line_fits_any_terminal(width, title):
    levels = training()
    levels[1].title = title
    levels[0].seconds_left = lambda: 99 * 60.0
    rows = shown(levels, width)
    assert len(rows) == 1
    assert len(rows[0]) <= width - len("^C")


def test_the_line_is_no_wider_than_what_it_says():
    (row,) = shown(training(), 120)
    assert len(row.rstrip()) == len(row) < 100


def test_80_columns_have_time_levels_and_what_counts():
    levels = training()
    levels[0].seconds_left = lambda: 720.0
    (row,) = shown(levels, 80)
    bar, rest = row[:8], row[8:]
    assert bar.rstrip() == "━╸"  # 23 % of 8, the rest is blank where there are no colours
    assert " ".join(rest.split()) == (
        "23 % 12 min left fold 3/10, haptic 2/3, epoch 4/40, votes 100%"
    )
    assert "loss 0.123, val 0.456, votes 100%" in shown(levels, 120)[0]


def test_a_narrow_line_keeps_the_outermost_and_the_innermost():
    inner = Level("Statistics of photos", 40, 8, counted=False)
    assert describe([*training()[:2], inner]) == "fold 3/10, haptic 2/3, statistics of photos 9/40"
    assert describe([*training()[:2], inner], 40) == "fold 3/10, statistics of photos 9/40"


@pytest.mark.parametrize(
    ("seconds", "text"), [(42.4, "42 s"), (61, "1 min"), (3000, "50 min"), (9000, "2.5 h")]
)
def test_length_of_time_in_words(seconds, text):
    assert format_seconds(seconds) == text
