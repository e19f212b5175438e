"""Tables of readers that somebody else wrote."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tex_lightning.data.readers import checked_table
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError

ROWS = tuple(
    Recording(label, "haptic", Path(f"{label}{group}.wav"), group)
    for label in ("oak", "steel")
    for group in range(3)
)


@pytest.mark.parametrize(
    "given",
    [
        Recordings(ROWS),
        Recordings([*ROWS]),
        Recordings(row for row in ROWS),
        Recordings(tuple(replace(row, group=np.int64(row.group)) for row in ROWS)),
        Recordings(tuple(replace(row, group=f"session {row.group}") for row in ROWS)),
        Recordings(tuple(replace(row, sampling_rate=np.float32(100)) for row in ROWS)),
        Recordings(
            tuple(
                replace(row, part=part, group=2 * row.group + number)
                for row in ROWS
                for number, part in enumerate([(0, 0.5), (0.5, 1)])
            )
        ),
    ],
)
def test_a_sound_table_is_taken(given):
    assert {row.label for row in checked_table(given, "Mine")} == {"oak", "steel"}


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (None, r"Mine.read\(\) of data.reader returned NoneType"),
        ([*ROWS], "returned list; let it return tex_lightning.Recordings"),
        (Recordings(()), "found no recordings"),
        (Recordings((("oak", "haptic"),)), "Record 1 of the table of Mine .* is tuple; make it"),
        (Recordings(ROWS + ROWS), "lists oak0.wav in record 1 and in record 7; keep one"),
        (
            Recordings((*ROWS, replace(ROWS[2], group=7))),
            "lists oak2.wav in record 3 and in record 7",
        ),
    ],
)
def test_what_is_no_table_is_refused(given, said):
    with pytest.raises(UserError, match=said):
        checked_table(given, "Mine")


@pytest.mark.parametrize(
    ("field", "values"),
    [
        ("label", ["", None, 1]),
        ("modality", ["haptic sense/é,1", "", 3]),
        ("path", ["a.wav", None]),
        ("group", [-1, " ", 1.0, None, True, np.zeros(2)]),
        ("sampling_rate", [0.0, -1, "100", float("nan"), float("inf"), True]),
        ("conditions", [{"speed": "1"}, (("speed", 1),), ("speed",), None]),
    ],
)
def test_a_wrong_field_is_named_with_its_record(field, values):
    for value in values:
        rows = (*ROWS[:4], replace(ROWS[4], **{field: value}))
        with pytest.raises(UserError, match=rf"^Record 5 of .* Mine .* has {field} .*; give "):
            checked_table(Recordings(rows), "Mine")
