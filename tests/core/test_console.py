"""How much is said, through the command line; whole words on a terminal."""

import io
import os
import re
import subprocess
import sys
import warnings

import numpy as np
import pytest
from PIL import Image
from rich.cells import cell_len
from rich.console import Console

from tex_lightning.config import CONF
from tex_lightning.core.console import Screen, console, say, suppress_warnings, verbosity
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning.report.table import make_table


def test_verbose_says_how_much_is_printed(cli, surfaces, tmp_path):
    folder = tmp_path / "run"

    def said(verbose: int) -> str:
        data = ["data=folder", f"data.root={surfaces}", f"hydra.run.dir={folder}"]
        outcome = cli("model=mfcc_nb", *data, f"verbose={verbose}")
        assert outcome.status == 0, outcome.err
        assert outcome.out == ""  # which belongs to predict, stream and record
        assert not {*outcome.err} & {"\r", "\x1b"}
        return outcome.err

    first, *_, last = (line for line in said(0).splitlines() if line.strip())
    assert first.strip() == "fit · mfcc_nb · folder"
    assert last == f"Results in {folder}"
    assert "Fitting mfcc_nb to 24 recordings." in (folder / "tex_lightning.log").read_text()
    (folder / "results.json").unlink()
    verbose = said(2)  # another verbose goes on
    assert re.search("Trains +mfcc_nb", verbose)
    assert "] Fold 0, mfcc_nb: 3 of 3 samples correct, trained in " in verbose
    assert "INFO" not in verbose
    assert Screen.verbose == 1


def test_errors_are_said_however_quiet(cli, tmp_path):
    outcome = cli("verbose=0", "task=predict", f"checkpoint={tmp_path}", "haptic=a.wav")
    assert outcome.status == 2
    assert outcome.err.startswith(f"Error: {tmp_path} holds no finished checkpoint")


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


def test_a_terminal_without_columns_is_written_to():
    code = "from tex_lightning.core.console import say; say('An error.')"
    ran = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "COLUMNS": "0"}, cwd=CONF.parent,
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert ran.stderr == "An error.\n"


@pytest.mark.filterwarnings("default")
def test_warnings_of_libraries_are_one_line_each_and_those_alike_one_in_all(caplog):
    with verbosity(1):
        for letter in range(3):
            text = f"Glyph {letter} (\\N{{LETTER {letter}}}) missing\n  from font."
            warnings.warn(text, UserWarning, stacklevel=1)
        warnings.warn("Another.", RuntimeWarning, stacklevel=1)
    first, second = caplog.messages
    assert first.startswith("Glyph 0 (\\N{LETTER 0}) missing from font. (test_console.py:")
    assert second.startswith("Another. (test_console.py:")


def test_nothing_that_is_shown_can_steer_the_terminal(capfd):
    say("Classes   2: a\x1b[31m, b\nRates")
    assert capfd.readouterr().err == "Classes   2: a\\x1b[31m, b\nRates\n"
    table = make_table("[/b] :smile:", ["[red]"], [])
    table.add_row("a\x1b[31m\u202e")
    console.print(table)
    said = capfd.readouterr().err
    assert all(text in said for text in ("[/b] :smile:", "[red]", "a\\x1b[31m\\u202e"))
    assert "\x1b" not in said


def test_warnings_of_readers_are_kept_in_and_the_filters_are_as_before():
    before = list(warnings.filters)
    with suppress_warnings():
        warnings.warn("inside", UserWarning, stacklevel=1)
    assert warnings.filters == before
    with pytest.warns(UserWarning, match="outside"):
        warnings.warn("outside", UserWarning, stacklevel=1)


def test_a_damaged_tiff_is_told_by_us_alone(tmp_path, capfd):
    path = tmp_path / "a.tif"
    Image.fromarray(np.zeros((48, 40, 3), np.uint8)).save(path, compression="tiff_lzw")
    content = bytearray(path.read_bytes())
    content[8:20] = b"\xff" * 12
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"a.tif is damaged or too large \(.*\); replace"):
        PhotoDecoder().decode(path)
    assert capfd.readouterr() == ("", "")
