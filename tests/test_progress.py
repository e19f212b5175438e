"""The progress line on a terminal in memory, and what is said where there is none."""

import io
import logging

import pytest
from rich.console import Console
from terminal import Screen

from tex_lightning import progress, screen
from tex_lightning.progress import begin, finishing, hidden, stage, steps, track
from tex_lightning.screen import ConsoleHandler, tell, verbosity


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
