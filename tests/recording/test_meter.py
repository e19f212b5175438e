"""One line in a terminal, JSON objects elsewhere."""

import io
import json
import re

import pytest
from rich.console import Console

from tex_lightning.recording import meter
from tex_lightning.recording.meter import Meter

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
    assert rows[0].count("━") == rows[1].count("━") == 20
    assert "4.9/5 s" in rows[2]
    assert "oak 0.88" in rows[2]


def test_elsewhere_each_chunk_is_a_json_object(capsys):
    with Meter(5) as shown:
        shown.show("oak_001", 0.1, 0.123456, FOUND)
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {
        "recording": "oak_001", "time": 0.1, "level": 0.1235, **FOUND
    }  # fmt: skip
    assert "\x1b" not in captured.out + captured.err
