"""The bars on a terminal in memory, and what is said where there is none."""

import io
import logging
import sys
import types
from functools import partial
from threading import Thread

import pytest
from rich.console import Console, RenderHook
from rich.progress import Progress
from terminal import Screen

from tex_lightning.core import console as screen
from tex_lightning.core import progress
from tex_lightning.core.console import ConsoleHandler, verbosity
from tex_lightning.core.progress import Stage, ending_stages, track


def use(monkeypatch, file: io.StringIO, **options: object) -> io.StringIO:
    """Have this as standard error."""
    console = Console(file=file, width=80, color_system=None, **options)
    for module in (progress, screen):
        monkeypatch.setattr(module, "console", console)
    return file


@pytest.fixture
def terminal(monkeypatch) -> Screen:
    return use(monkeypatch, Screen(), force_terminal=True)


@pytest.fixture
def file(monkeypatch) -> io.StringIO:
    return use(monkeypatch, io.StringIO())


@pytest.fixture
def logger(monkeypatch):
    """Give a logger of the package or of a library, to the screen."""

    def to_screen(name: str, level: int = logging.DEBUG) -> logging.Logger:
        logger = logging.getLogger(name)
        for key, value in (
            ("handlers", [ConsoleHandler()]),
            ("propagate", False),
            ("level", level),
        ):
            monkeypatch.setattr(logger, key, value)
        logger.manager._clear_cache()  # of what is enabled
        return logger

    return to_screen


@pytest.fixture
def log(logger) -> logging.Logger:
    return logger("tex_lightning")


def run_folds(log: logging.Logger) -> None:
    """Two folds of two networks of two epochs, each tested."""
    for fold in track([0, 1], "fold"):
        for name in track(["haptic", "fusion"], str):
            with Stage("epoch", 2) as epochs:
                for epoch in range(2):
                    epochs.update(epoch + 1, notes=["loss 1.23", "accuracy 40%"])
                    Stage.bars.refresh()
            for _ in track(range(3), "Testing"):
                Stage.bars.refresh()
            log.info("Fold %d, %s: %d of 5 samples correct. %s", fold, name, fold, "words " * 12)


def test_bars_stand_below_each_other_and_go_away(terminal, log):
    run_folds(log)
    said = [text for text in terminal.lines if text]
    assert [text[:15] for text in said[::2]] == [
        "Fold 0, haptic:", "Fold 0, fusion:", "Fold 1, haptic:", "Fold 1, fusion:",
    ]  # fmt: skip
    assert all(text.startswith("words") for text in said[1::2])
    assert not terminal.cursor_is_hidden
    assert terminal.widest <= 80
    for shown in ("fold 2/2", "fusion 2/2", "epoch 2/2, loss 1.23, accuracy 40%", "Testing 3/3"):
        assert any(row.endswith(shown) for row in terminal.drawn)


class Redrawn(RenderHook):
    """Has another thread redraw the bars while a line is on its way to the terminal."""

    def process_renderables(self, renderables):
        thread = Thread(target=Stage.bars.refresh)
        thread.start()
        thread.join(0.2)
        return renderables


def test_no_line_is_lost_where_a_thread_redraws_fewer_bars(terminal, log, monkeypatch):
    monkeypatch.setattr(progress, "Progress", partial(Progress, auto_refresh=False))
    with Stage("fold", 3):
        with Stage("network", 3), Stage("epoch", 3):
            log.info("The first line.")
        progress.console.push_render_hook(Redrawn())
        log.info("The second line.")
    assert [text for text in terminal.lines if text] == ["The first line.", "The second line."]


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_an_interruption_leaves_no_line_and_shows_the_cursor(terminal, error):
    def run() -> None:
        with ending_stages(), Stage("fold", 3):
            for _ in track(range(3), "Testing"):
                assert terminal.cursor_is_hidden
                raise error

    with pytest.raises(error):
        run()
    assert not terminal.cursor_is_hidden
    assert terminal.text == ""
    assert Stage.levels == []


def test_a_file_gets_a_line_a_minute_and_no_control_characters(file, log, monkeypatch):
    run_folds(log)
    assert "Testing" not in file.getvalue()
    monkeypatch.setattr(progress, "TOLD", 0.0)
    run_folds(log)
    lines = file.getvalue().splitlines()
    assert "In progress: fold 2/2; haptic 1/2; Testing 1/3." in lines
    told = [line.split(": ")[1].rstrip(".").split("; ") for line in lines if "In prog" in line]
    assert all(part.strip() == part != "" for parts in told for part in parts)  # each has a title
    assert not [part for parts in told for part in parts if part[0].isdigit()]
    assert not {*file.getvalue()} & {"\r", "\x1b", "━"}


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
        assert terminal.raw == ""
        log.error("This is wrong.")
    assert terminal.text == "This is wrong."


def test_whoever_debugs_is_told_what_others_say(file, logger):
    other = logger("a_library.of.others", logging.INFO)
    other.info("one")
    other.warning("two")
    with verbosity(2):
        other.info("three")
    assert file.getvalue().splitlines() == [
        "two (a_library.of.others)", "three (a_library.of.others)",
    ]  # fmt: skip


def test_a_notebook_has_one_line_that_is_written_anew(monkeypatch):
    shown = []

    class Handle:
        def update(self, data, raw):
            shown.append(("update", data["text/plain"], raw))

    def display(data, raw, display_id):
        shown.append(("display", data["text/plain"], raw and display_id))
        return Handle()

    class Shell:
        execution_count = 7

    notebook = types.ModuleType("IPython")
    notebook.get_ipython = Shell
    notebook.display = types.SimpleNamespace(display=display)
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    monkeypatch.setattr(progress.NotebookLine, "handle", None)
    monkeypatch.setattr(progress, "SHOWN", 0)
    monkeypatch.setattr(progress.console, "is_jupyter", True)
    monkeypatch.setattr(progress.console, "quiet", False)
    with verbosity(1):
        assert [*track("ab", "letter")] == ["a", "b"]
    Shell.execution_count = 8
    with verbosity(1):
        assert [*track("c", "letter")] == ["c"]
    with verbosity(0):
        assert [*track("de", "letter")] == ["d", "e"]
    assert shown == [
        ("display", "letter 1/2", True), ("update", "letter 2/2", True), ("update", "", True),
        ("display", "letter", True), ("update", "", True),
    ]  # fmt: skip
