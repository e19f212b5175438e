"""How much is said, through the command line; whole words on a terminal."""

import io
import json
import logging
import re
import warnings

import pytest
from rich.cells import cell_len
from rich.console import Console

from tex_lightning.core.console import Screen, console, fresh_screen, log_once, say, tell, verbosity
from tex_lightning.report.table import make_table


@pytest.fixture
def quick(cli, surfaces, tmp_path):
    """Run something in a moment, in a folder that goes on with what is there."""
    data = ["data=folder", f"data.root={surfaces}", f"hydra.run.dir={tmp_path / 'run'}"]

    def run(*arguments: str):
        outcome = cli("model=mfcc_nb", *data, *arguments)
        assert outcome.status == 0, outcome.err
        assert outcome.out == ""  # which belongs to predict, stream and record
        assert not {*outcome.err} & {"\r", "\x1b"}
        return outcome.err

    return run


def test_verbose_says_how_much_is_printed(quick, tmp_path):
    quiet = quick("verbose=0")
    first, *_, last = (line for line in quiet.splitlines() if line.strip())
    assert first.strip() == "fit · mfcc_nb · folder"
    assert last == f"Results in {tmp_path / 'run'}"
    log = tmp_path / "run" / "tex_lightning.log"
    assert "Fitting mfcc_nb to 24 recordings." in log.read_text()  # all the same
    assert "This run is finished already." in quick("verbose=1")  # another verbose goes on
    (tmp_path / "run" / "results.json").unlink()
    verbose = quick("verbose=2")
    assert re.search("Trains +mfcc_nb", verbose)
    assert "] Fold 0, mfcc_nb: 3 of 3 votes correct, trained in " in verbose
    assert "INFO" not in verbose
    assert "] Testing: 0." in verbose
    assert Screen.verbose == 1


def test_errors_are_said_however_quiet(cli, tmp_path):
    outcome = cli("verbose=0", "task=predict", f"checkpoint={tmp_path}", "haptic=a.wav")
    assert outcome.status == 2
    assert outcome.err.startswith(f"Error: {tmp_path} holds no finished checkpoint")
    outcome = cli("verbose=3")
    assert outcome.err == "Error: verbose is 3: choose from 0 to 2.\n"


@pytest.mark.slow
def test_quiet_sweeps_say_the_table_of_all_jobs(cli, surfaces, tmp_path):
    data = ["data=folder", f"data.root={surfaces}", f"hydra.sweep.dir={tmp_path}"]
    outcome = cli(
        "-m", "model=mfcc_nb", "verbose=0", "data.test_fold=0,1", "data.val_fold=null", *data
    )
    assert outcome.status == 0, outcome.err
    first, *_, last = (line for line in outcome.err.splitlines() if line.strip())
    assert (first.strip(), last) == ("sweep", f"Summary in {tmp_path / 'sweep.csv'}")
    done = [json.loads((tmp_path / job / "results.json").read_text()) for job in "01"]
    assert all(results["networks"]["haptic"]["correct"] == 3 for results in done)


def test_a_terminal_wraps_sentences_at_words_and_commands_by_itself(monkeypatch):
    shown = io.StringIO()
    console = Console(file=shown, width=40, color_system=None, force_terminal=True)
    monkeypatch.setattr("tex_lightning.core.console.console", console)
    for text in (
        "The folder of the run holds another run; choose another one.",
        "木材 の表面 は 粗い, " * 3,
    ):
        say(text)
    rows = shown.getvalue().splitlines()
    assert 30 < max(cell_len(row.rstrip()) for row in rows) <= 40
    assert rows[0].rstrip() == "The folder of the run holds another run;"
    say("python -m tex_lightning " + "x" * 80, wraps=False)
    assert shown.getvalue().splitlines()[-1].endswith("x" * 80)


@pytest.mark.filterwarnings("default")
def test_warnings_of_libraries_are_one_line_each_and_those_alike_one_in_all(caplog):
    with fresh_screen(), verbosity(1):
        for letter in range(3):
            text = f"Glyph {letter} (\\N{{LETTER {letter}}}) missing\n  from font."
            warnings.warn(text, UserWarning, stacklevel=1)
        warnings.warn("Another.", RuntimeWarning, stacklevel=1)
    first, second = caplog.messages
    assert first.startswith("Glyph 0 (\\N{LETTER 0}) missing from font. (test_console.py:")
    assert second.startswith("Another. (test_console.py:")


def test_what_is_the_same_for_every_fold_is_logged_once(caplog):
    log = logging.getLogger("tex_lightning.test")
    for _ in range(2):  # commands
        with fresh_screen(), caplog.at_level("INFO"):
            for _ in range(10):
                log_once(log, "The trunk begins with /a/long/path.pth.")
    assert caplog.messages == ["The trunk begins with /a/long/path.pth."] * 2


def test_a_table_takes_no_markup_no_emoji_and_no_control_characters(capfd):
    table = make_table("[/b] :smile:", ["[red]"], [])
    table.add_row("a\x1b[31m\u202e")
    console.print(table)
    said = capfd.readouterr().err
    assert "[/b] :smile:" in said
    assert "[red]" in said
    assert "a\\x1b[31m\\u202e" in said
    assert "\x1b" not in said


def test_names_cannot_steer_the_terminal(capfd):
    tell("Classes   2: a\x1b[31m, b\nRates")
    assert capfd.readouterr().err == "Classes   2: a\\x1b[31m, b\nRates\n"
