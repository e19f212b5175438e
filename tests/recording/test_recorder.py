"""One line in a terminal, JSON objects elsewhere."""

import io
import json
import re

import pytest
from rich.console import Console
from terminal import Screen

from tex_lightning.recording import recorder as meter
from tex_lightning.recording.recorder import Meter

LONG = "a_class_with_a_name_that_is_much_longer_than_its_place"
FOUND = {"label": LONG, "probability": 0.5}


@pytest.fixture
def terminal(monkeypatch):
    screen = io.StringIO()
    console = Console(file=screen, force_terminal=True, width=80, color_system=None)
    monkeypatch.setattr(meter, "console", console)
    return screen


def test_a_terminal_has_one_line_of_80_columns(terminal, monkeypatch, capsys):
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    with Meter(5) as shown:
        shown.show(None, 0, 0.01, {})
        shown.show(f"{LONG}_001", 4.9, 1.0, FOUND)
        shown.show("oak_001", 4.9, 0.1, {"label": "oak", "probability": 0.875})
    assert capsys.readouterr().out == ""
    rows = [
        re.sub(r"\x1b\[[^A-Za-z]*[A-Za-z]", "", row)
        for row in re.split("[\r\n]+", terminal.getvalue())
    ]
    rows = list(dict.fromkeys(row for row in rows if row.strip()))  # the last is drawn twice
    assert len(rows) == 3
    assert max(map(len, rows)) < 80
    assert "waiting for contact" in rows[0]
    assert rows[0].count("━") == rows[1].count("━") == 10
    assert "4.9/5 s" in rows[2]
    assert "0.88 oak" in rows[2]


@pytest.mark.parametrize("columns", [40, 80, 120])
def test_any_terminal_has_room_for_an_interruption_and_the_label(monkeypatch, columns):
    screen = Screen(columns)
    console = Console(file=screen, width=columns, force_terminal=True, color_system=None)
    monkeypatch.setattr(meter, "console", console)
    monkeypatch.setattr(meter, "prints_lines", lambda: False)
    with Meter(5) as shown:
        shown.show(None, 0.0, 0.01, {})
        assert "contact" in screen.text
        found = {"label": "G1SquaredAluminumMesh", "probability": 0.876}
        shown.show("steel_001", 1.25, 12345.6789, found)
        (row,) = screen.text.splitlines()
        assert "1.2/5 s     0.88 G1Squar" in row
        assert ("G1SquaredAluminum" in row) == (columns >= 80)
        assert ("steel_001" in row) == (columns >= 60)
    assert screen.widest <= columns - len("^C")
    assert screen.text == ""
    assert not screen.cursor_is_hidden


def test_elsewhere_each_chunk_is_a_json_object(capsys):
    with Meter(5) as shown:
        shown.show("oak_001", 0.1, 0.123456, FOUND)
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {
        "recording": "oak_001", "time": 0.1, "level": 0.1235, **FOUND
    }  # fmt: skip
    assert "\x1b" not in captured.out + captured.err
