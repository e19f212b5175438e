"""The progress line on a terminal in memory, and what is said where there is none."""

import io
import logging
import time
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from terminal import Screen

from tex_lightning.core import console as screen
from tex_lightning.core import progress
from tex_lightning.core.console import ConsoleHandler, tell, verbosity
from tex_lightning.core.progress import (
    Level,
    begin,
    describe,
    finishing,
    format_seconds,
    hidden,
    line,
    seconds_left,
    sentence,
    share,
    stage,
    steps,
    track,
)


def use(monkeypatch, file: io.StringIO, **options: object) -> None:
    """Have this as standard error."""
    console = Console(file=file, width=80, color_system=None, **options)
    for module in (progress, screen):
        monkeypatch.setattr(module, "console", console)
    monkeypatch.setattr(progress, "REDRAWN", 0.0)


@pytest.fixture
def terminal(monkeypatch) -> Screen:
    shown = Screen()
    use(monkeypatch, shown, force_terminal=True)
    return shown


@pytest.fixture
def file(monkeypatch) -> io.StringIO:
    written = io.StringIO()
    use(monkeypatch, written)
    return written


@pytest.fixture
def log() -> logging.Logger:
    """The package's, to the screen."""
    logger, handler = logging.getLogger("tex_lightning"), ConsoleHandler()
    before = logger.level, logger.propagate
    logger.setLevel(logging.DEBUG)
    logger.propagate = False  # to what an earlier command line has configured
    logger.addHandler(handler)
    yield logger
    logger.removeHandler(handler)
    logger.level, logger.propagate = before


def run_folds(log: logging.Logger) -> None:
    """Two folds of two networks of two epochs, each tested."""
    for fold in steps([0, 1], "fold"):
        for name in steps(["haptic", "fusion"], str):
            epochs = begin("epoch", 2)
            for epoch in range(2):
                epochs.update(epoch + 1, notes=["loss 1.23", "votes 40%"])
            epochs.end()
            for _ in track(range(3), "Testing"):
                pass
            log.info("Fold %d, %s: %d of 5 votes correct. %s", fold, name, fold, "words " * 12)


def test_one_line_is_drawn_over_and_goes_away(terminal, log):
    run_folds(log)
    said = [text for text in terminal.lines if text]
    assert [text[:15] for text in said[::2]] == [
        "Fold 0, haptic:", "Fold 0, fusion:", "Fold 1, haptic:", "Fold 1, fusion:",
    ]  # fmt: skip
    assert all(text.startswith("words") for text in said[1::2])
    assert not terminal.cursor_is_hidden
    assert terminal.widest <= 80
    percents = [int(row.partition(" %")[0].split()[-1]) for row in terminal.drawn]
    assert percents == sorted(percents)
    assert {0, 25, 50, 75, 99} <= {*percents}
    assert any(row.endswith("fold 2/2, haptic 1/2, testing 3/3") for row in terminal.drawn)
    assert any("fusion 2/2, epoch 2/2, votes 40%" in row for row in terminal.drawn)


def test_never_are_two_lines_on_the_screen(terminal, log, monkeypatch):
    seen = []
    monkeypatch.setattr(log, "info", lambda *_: seen.append(terminal.text))
    run_folds(log)
    assert [text.count(" % ") for text in seen] == [1, 1, 1, 1]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interruption_leaves_no_line_and_shows_the_cursor(terminal, error):
    def run() -> None:
        with finishing(), stage("fold", 3):
            for _ in track(range(3), "Testing"):
                assert terminal.cursor_is_hidden
                raise error

    with pytest.raises(error):
        run()
    assert not terminal.cursor_is_hidden
    assert terminal.text == ""
    assert progress.Work.stages == []


def test_a_file_gets_a_sentence_a_minute_and_no_control_characters(file, log, monkeypatch):
    run_folds(log)
    assert "done" not in file.getvalue()
    monkeypatch.setattr(progress, "TOLD", 0.0)
    run_folds(log)
    assert "50 % done" in file.getvalue()
    assert ": fold 2/2, haptic 1/2, testing 1/3." in file.getvalue()
    assert not {*file.getvalue()} & {"\r", "\x1b", "━"}


def test_a_notebook_without_logging_is_told_as_well(file, monkeypatch):
    monkeypatch.setattr(progress, "TOLD", 0.0)
    monkeypatch.setattr(progress.log, "hasHandlers", lambda: False)
    list(track(range(2), "Decoding"))
    assert file.getvalue().splitlines()[-1] == "50 % done: Decoding 2/2."


@pytest.mark.parametrize(("name", "value"), [("TERM", "dumb"), ("FORCE_COLOR", "1")])
def test_only_a_terminal_that_can_is_drawn_on(monkeypatch, name, value):
    monkeypatch.setenv(name, value)
    written = Screen() if name == "TERM" else io.StringIO()
    use(monkeypatch, written, force_terminal=True if name == "TERM" else None)
    list(track(range(3), "Testing"))
    assert written.getvalue() == getattr(written, "raw", "") == ""


def test_nothing_is_drawn_for_whoever_wants_quiet(terminal, log):
    with verbosity(0):
        run_folds(log)
        tell("Data")
        assert terminal.raw == ""
        log.error("This is wrong.")
    assert terminal.text == "This is wrong."


def test_another_progress_bar_has_the_terminal_for_itself(terminal):
    with stage("fold", 3) as folds:
        with hidden():
            assert not terminal.cursor_is_hidden
            folds.update(1)
            assert terminal.text == ""
        folds.update(2)
        assert "fold 3/3" in terminal.text


def test_timings_are_said_to_whoever_debugs(file, log):
    list(track(range(3), "Decoding"))
    assert file.getvalue() == ""
    with verbosity(2):
        list(track(range(3), "Decoding"))
    assert file.getvalue() == "Decoding: 0.00 s.\n"


def test_messages_of_others_are_for_whoever_debugs(file, monkeypatch):
    other, handler = logging.getLogger("a_library.of.others"), ConsoleHandler()
    other.addHandler(handler)
    other.setLevel(logging.INFO)
    other.propagate = False
    other.info("one")
    other.warning("two")
    with verbosity(2):
        other.info("three")
    other.removeHandler(handler)
    assert file.getvalue() == "two (a_library.of.others)\nthree (a_library.of.others)\n"


def test_tables_of_others_are_cut_where_the_terminal_ends(terminal):
    other, handler = logging.getLogger("a_library.of.others"), ConsoleHandler()
    other.addHandler(handler)
    other.setLevel(logging.INFO)
    other.propagate = False
    with verbosity(2):
        other.info("table\n%s\n%s", "-" * 100, "word " * 20)
    other.removeHandler(handler)
    tell("/folder" * 20)
    assert "/folder" * 20 in terminal.raw
    assert [len(row) for row in terminal.text.splitlines()][:2] == [5, 80]
    assert len([row for row in terminal.text.splitlines() if row.startswith("word")]) == 1


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
