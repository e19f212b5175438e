import json
import shlex
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from haptic_sets import read
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.data.manifest import read_manifest, write_manifest
from tex_lightning.data.readers import checked_table
from tex_lightning.data.recordings import (
    Recording,
    Recordings,
    cut_part,
    overlap,
    with_one_spelling,
)
from tex_lightning.errors import UserError

HEADER = "label,modality,path,group\n"


def manifest(tmp_path: Path, lines: str) -> Path:
    (tmp_path / "a.wav").write_bytes(b"x")
    path = tmp_path / "m.csv"
    path.write_text(lines, encoding="utf-8")
    return path


def test_a_manifest_survives_a_round_trip(tmp_path):
    path = manifest(tmp_path, HEADER + "wood,haptic,a.wav,3\n")
    table = read_manifest(path)
    assert table.rows == (Recording("wood", "haptic", (tmp_path / "a.wav").resolve(), 3),)
    elsewhere = tmp_path / "copy.csv"
    write_manifest(table, elsewhere)
    assert read_manifest(elsewhere) == table
    assert elsewhere.read_text().splitlines() == [
        "label,modality,path,group,rate",
        "wood,haptic,a.wav,3,",
    ]


def test_a_spreadsheets_semicolons_and_decimal_commas_are_read(tmp_path):
    lines = "\ufefflabel;modality;path;group;rate\r\nw;haptic;a.wav;0;2500,5\r\n"
    assert read_manifest(manifest(tmp_path, lines)).rows[0].sampling_rate == 2500.5


@pytest.mark.parametrize(
    "content",
    [
        HEADER.replace(",", "\t") + "w\thaptic\tsub/a.wav\t0\n",
        "sep=;\n" + HEADER.replace(",", ";") + "w;Haptics;sub/a.wav;0\n;;;\n\n",
        HEADER.replace(",", ", ") + "w, haptic, sub\\a.wav , 0\n",
        HEADER.replace(",", "|") + "w|haptic|.\\sub\\a.wav|0\n",
        "# of Monday\n\n#\n" + HEADER.title() + "w,haptic,sub/a.wav,0\n",
        "y,modality,path,GROUP\nw,haptic,~/sub/a.wav,0\n",
        "ClassId,modality,Wav File,group\nw,haptic,sub/a.wav,0\n",
        (HEADER + "w,haptic,sub/a.wav,0\n").encode("utf-16"),
        (HEADER + "w,haptic,sub/a.wav,0\n").replace("\n", "\r").encode("utf-8-sig"),
    ],
)
def test_manifests_as_programs_and_people_write_them(tmp_path, content, monkeypatch):
    monkeypatch.setenv("HOME", str(tmp_path))
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.wav").touch()
    path = tmp_path / "m.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert read_manifest(path).rows == (Recording("w", "haptic", tmp_path / "sub" / "a.wav", 0),)


@pytest.mark.parametrize(
    ("rate", "mark", "expected"),
    [
        ("10.000", ";", 10_000),
        ('"10,000"', ",", 10_000),
        ("62.125", ",", 62.125),
        ("62,5", ";", 62.5),
    ],
)
def test_marks_of_thousands_in_rates_are_those_of_the_separator(tmp_path, rate, mark, expected):
    lines = "label,modality,path,group,rate\nw,haptic,a.wav,0,{}\n".replace(",", mark)
    assert read_manifest(manifest(tmp_path, lines.format(rate))).rows[0].sampling_rate == expected


def test_a_path_may_be_relative_to_the_folder_above_that_of_the_manifest(tmp_path):
    for name in ("data/a.wav", "data/b.wav", "c.wav", "lists/deep/c.wav"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    path = tmp_path / "lists" / "train.csv"
    path.write_text("label,image_path\noak,data/a.wav\nelm,data\\b.wav\nash,c.wav\n")
    path.write_text(f"{path.read_text()}ash,{(tmp_path / 'c.wav').as_uri()}\n")
    found = [row.path.relative_to(tmp_path).as_posix() for row in read_manifest(path)]
    assert found == ["data/a.wav", "data/b.wav", "lists/deep/c.wav", "c.wav"]


def test_a_missing_file_is_not_one_of_its_name_in_the_folder_above(tmp_path):
    for name in ("oak/1.wav", "1.wav", "set/new/oak/2.wav", "set/oak/1.wav"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    path = tmp_path / "set" / "new" / "labels.csv"
    for missing in ("oak/1.wav", "./oak/1.wav", "../1.wav"):
        path.write_text(f"label,path\noak,{missing}\nelm,oak/2.wav\n")
        assert [row.path.is_file() for row in read_manifest(path)] == [False, True]
    path.write_text("label,path\noak,../1.wav\n")
    assert not read_manifest(path).rows[0].path.is_file()


def test_conditions_that_name_files_are_told(tmp_path):
    lines = "label,wav_file,photo,state\noak,1.wav,1.jpg,wet\nelm,2.wav,,dry.2\n"
    notes = read_manifest(manifest(tmp_path, lines)).notes
    assert [note for note in notes if "files that it names are not read" in note] == [notes[-1]]
    assert notes[-1].startswith("The column photo is a condition")


def test_parts_of_a_file_may_share_it_unless_they_overlap(tmp_path):
    header = "label,modality,path,group,part\n"
    lines = "w,haptic,a.wav,0,0-0.25\nw,haptic,a.wav,1,0.25-1\n"
    table = read_manifest(manifest(tmp_path, header + lines))
    assert [row.part for row in table] == [(0, 0.25), (0.25, 1)]
    assert [row.source.rpartition("/")[2] for row in table] == ["a.wav#0-0.25", "a.wav#0.25-1"]
    assert [row.conditions for row in table] == [(), ()]
    write_manifest(table, tmp_path / "copy.csv")
    assert read_manifest(tmp_path / "copy.csv") == table
    for other in ("0.2-0.3", ""):
        lines = f"w,haptic,a.wav,0,0-0.25\nw,haptic,a.wav,1,{other}\n"
        with pytest.raises(UserError, match="in record 1 and in record 2"):
            read_manifest(manifest(tmp_path, header + lines))


def test_a_group_is_any_text_and_the_same_in_all_classes(tmp_path):
    names = ["0", "007", "-1", "1.0", "F120_V-100_0", "Jörg, Mo", "9" * 30, "²"]
    lines = [f'w,haptic,a.wav,"{name}",{n / 8}-{(n + 1) / 8}\n' for n, name in enumerate(names)]
    path = manifest(tmp_path, "label,modality,path,group,part\n" + "".join(lines))
    rows = read_manifest(path).rows
    assert [row.group for row in rows] == [0, 7, *names[2:]]
    assert [row.group_key for row in rows] == ["0", "7", *names[2:]]
    write_manifest(Recordings(rows), tmp_path / "again.csv")
    assert read_manifest(tmp_path / "again.csv").rows == rows


@pytest.mark.parametrize(
    ("cells", "folds", "note"),
    [
        (["1", "0", "2"], [1, 0, 2], None),
        (["10", "1", "2"], [2, 0, 1], "numbered from 0: 0 is 1, 1 is 2, 2 is 10."),
        (["train", "test", "train"], [1, 0, 1], "0 is test, 1 is train"),
        (["", "", ""], [None] * 3, None),
    ],
)
def test_a_column_fold_fixes_the_folds_and_is_no_condition(tmp_path, cells, folds, note):
    lines = [f"w,haptic,{n}.wav,{n},{cell},60\n" for n, cell in enumerate(cells)]
    path = manifest(tmp_path, "label,modality,path,group,fold,speed\n" + "".join(lines))
    table = read_manifest(path)
    assert [row.fold for row in table] == folds
    assert {row.conditions for row in table} == {(("speed", "60"),)}
    assert [note in text for text in table.notes] == ([] if note is None else [True])
    write_manifest(table, tmp_path / "again.csv")
    assert [row.fold for row in read_manifest(tmp_path / "again.csv")] == folds


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ("path,group\n", "has no column label; its first line must name .* group may be left out"),
        (HEADER, "lists no recordings"),
        ("label,path,label\n", "has several columns label; keep one of them"),
        (
            "label,sensor_file,sound_file\n",
            "has a column of files 'sound_file' and none called path",
        ),
        ("label,profile\n", "has no column path;"),
        ("label,audio_file\n", "has no column path;"),
        ("label,sound_path\n", "has a column of files 'sound_path' and none called path"),
        ("label,haptic,wav_path\n", "a column of files 'haptic' and none called path"),
        ("label,haptic,image_path\n", "a column of files 'haptic' .* a line for each file"),
        ("lable,modality,path,group\n", "a column 'lable'; call it label"),
        (HEADER + "w,two words,a.wav,0\n", "line 2 has modality 'two words'; give one word"),
        (HEADER + "w,haptic,a.wav,\n", "group ''; give a text, such as a session"),
        ("label,modality,path,group,rate\nw,haptic,a.wav,0,fast\n", "rate 'fast'; give a number"),
        ("label,modality,path,group,rate\nw,haptic,a.wav,0,-2\n", "rate -2.0; give a number of"),
        ("label,modality,path,group,part\nw,haptic,a.wav,0,0.5\n", "part '0.5'.* such as 0-0.5"),
        ("label,modality,path,group,part\nw,haptic,a.wav,0,0.5-0.1\n", "part '0.5-0.1'; give two"),
        (HEADER + ",haptic,a.wav,1\n", "label ''; give a name"),
        (
            "label,modality,path,group,fold\nw,haptic,a.wav,0,1\nw,haptic,b.wav,1,\n",
            "line 3 has no fold; fill in the column fold everywhere or nowhere",
        ),
        (HEADER + "w,haptic,a.wav,0\nw\n", "line 3 has modality ''"),
        (HEADER + "w,haptic,a.wav,0\nv,haptic,a.wav,1\n", "in record 1 and in record 2"),
        (HEADER + "oak,dry,haptic,a.wav,0\n", 'line 2 has more cells than .* put "quotes" around'),
        (HEADER + f"w,{'-' * 5000},a.wav,0\n", "has modality .*more characters"),
    ],
)
def test_what_is_wrong_with_a_manifest_is_said(tmp_path, lines, message):
    with pytest.raises(UserError, match=message) as caught:
        read_manifest(manifest(tmp_path, lines))
    assert len(str(caught.value)) < 700


@pytest.mark.parametrize(
    ("column", "meant"),
    [
        *((name, "rate") for name in ("sampling_rate", "SampleRate", "Rate", "fs", "rate (Hz)")),
        *((name, "rate") for name in ("sampling frequency", "rates", "rtae", "sample_rate_hz")),
        *(("Parts", "part"), ("folds", "fold"), ("Paths", "path"), ("labels", "label")),
        *((name, None) for name in ("feed_rate", "patch", "party", "gold", "date", "force", "sr")),
    ],
)
def test_a_column_that_is_nearly_a_known_one_is_asked_about(tmp_path, column, meant):
    path = manifest(tmp_path, f"{HEADER.strip()},{column}\nw,haptic,a.wav,0,100\n")
    if meant is None:
        assert read_manifest(path).rows[0].conditions == ((column, "100"),)
    else:
        with pytest.raises(UserError, match=f"call it {meant} if it is meant, or otherwise if"):
            read_manifest(path)


def test_a_manifest_that_is_no_text_or_not_there(tmp_path):
    (tmp_path / "m.csv").write_bytes(b"PK\x03\x04" + bytes(90))
    with pytest.raises(UserError, match=r"an Excel workbook .* export it as CSV"):
        read_manifest(tmp_path / "m.csv")
    with pytest.raises(UserError, match="does not exist"):
        read_manifest(tmp_path / "none.csv")


def test_classes_are_distinct_and_in_natural_order():
    rows = [Recording(label, "image", Path(), 0) for label in ("c10", "c2", "c2")]
    assert Recordings(tuple(rows)).classes == ["c2", "c10"]
    alike = [Recording(label, "image", Path(), 0) for label in ("wood", "Wood", "a01", "a1")]
    assert Recordings(tuple(alike)).classes == ["a01", "a1", "Wood", "wood"]


BORDERS = st.floats(0, 1).map(lambda x: round(x, 9))
PARTS = st.tuples(BORDERS, BORDERS).filter(lambda part: part[0] < part[1])


@given(PARTS, PARTS)
def test_parts_overlap_if_they_share_a_point_inside(one, other):
    shared = min(map(Fraction, (one[1], other[1]))) - max(map(Fraction, (one[0], other[0])))
    assert overlap(one, other) == overlap(other, one) == (shared > 0)
    assert overlap(one, None)
    assert overlap(None, other)


@given(st.integers(1, 12), st.integers(12, 60))
def test_adjacent_parts_hold_every_sample_once(count, samples):
    array, borders = np.arange(samples)[None], np.linspace(0, 1, count + 1).tolist()
    pieces = [cut_part(array, part, Path("a.wav")) for part in pairwise(borders)]
    np.testing.assert_array_equal(np.concatenate(pieces, axis=1), array)
    assert max(piece.shape[1] for piece in pieces) - min(piece.shape[1] for piece in pieces) <= 1


ROWS = tuple(
    Recording(label, "haptic", Path(f"{label}{group}.wav"), group)
    for label in ("oak", "steel")
    for group in range(3)
)


@pytest.mark.parametrize(
    "given",
    [
        Recordings(row for row in ROWS),
        Recordings(tuple(replace(row, group=np.int64(row.group)) for row in ROWS)),
        Recordings([replace(row, sampling_rate=np.float32(100)) for row in ROWS]),
        Recordings([replace(row, part=part) for row in ROWS for part in [(0, 0.5), (0.5, 1)]]),
        Recordings([replace(row, part=(np.float32(0), Fraction(1, 2))) for row in ROWS]),
        Recordings([replace(row, fold=np.int64(row.group)) for row in ROWS]),
    ],
)
def test_a_sound_table_is_taken_with_numbers_that_json_knows(given):
    table = checked_table(given, "Mine")
    assert {row.label for row in table} == {"oak", "steel"}
    for row in table:
        json.dumps([row.group, row.sampling_rate, row.part, row.fold])


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
        ("group", [-1, " ", 1.0, None, np.zeros(2)]),
        ("sampling_rate", [0.0, -1, "100", float("nan"), float("inf")]),
        ("fold", [-1, "1", 0.5]),
        ("conditions", [{"speed": "60"}, ("speed", "60"), (("speed", 60),), None]),
        ("part", [(0.5, 0.2), (0, 2), ("0", "1"), (0.5,), "0-0.5"]),
    ],
)
def test_a_wrong_field_is_named_with_its_record(field, values):
    for value in values:
        rows = (*ROWS[:4], replace(ROWS[4], **{field: value}))
        with pytest.raises(UserError, match=rf"^Record 5 of .* Mine .* has {field} .*; give "):
            checked_table(Recordings(rows), "Mine")


def test_folds_of_a_table_are_for_all_and_divide_no_group_in_silence():
    fixed = [replace(row, fold=row.group) for row in ROWS]
    assert checked_table(Recordings(tuple(fixed)), "Mine").notes == ()
    (note,) = checked_table(Recordings((*fixed[:-1], replace(fixed[-1], fold=0))), "Mine").notes
    assert "divide 1 groups, 2 into folds 0, 2" in note
    with pytest.raises(UserError, match="no fold; give every recording one, or none"):
        checked_table(Recordings((*fixed[:-1], ROWS[-1])), "Mine")


def test_files_that_are_where_they_are_named_are_not_looked_for(tmp_path, monkeypatch):
    """Names alone are, once for all lines."""
    for name in ("a.wav", "b.wav", "c.wav"):
        path = tmp_path / "deep" / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
    walked = []
    every = Path.rglob
    monkeypatch.setattr(Path, "rglob", lambda *told: walked.append(told) or every(*told))
    lines = "label,modality,path,group\nw,haptic,deep/a.wav,0\nw,haptic,deep\\b.wav,1\n"
    assert len(read_manifest(manifest(tmp_path, lines))) == 2
    assert walked == []
    table = read_manifest(manifest(tmp_path, lines + "w,haptic,c.wav,2\nw,haptic,d.wav,3\n"))
    assert [row.path.name for row in table if row.path.is_file()] == ["a.wav", "b.wav", "c.wav"]
    assert len(walked) == 1


def test_spans_that_may_be_parts_are_told(tmp_path):
    for names, told in (
        ("start,end", 1),
        ("Onset_s,Duration_s", 1),
        ("start,part", 0),
        ("end,x", 0),
    ):
        lines = (
            f"label,modality,path,group,{names}\na,haptic,1.wav,0,0,0.5\nb,haptic,2.wav,0,0,0.5\n"
        )
        notes = read_manifest(manifest(tmp_path, lines.replace("0,0.5", "0,0-0.5"))).notes
        assert ["and files are read whole; give a column part" in x for x in notes] == [True] * told


def test_what_may_be_a_group_or_a_division_is_told(tmp_path):
    lines = [f"w{n % 2},{n}.wav,s{n % 3},{'test' if n > 4 else 'train'}\n" for n in range(8)]
    path = manifest(tmp_path, "label,path,session,split\n" + "".join(lines))
    assert "The column session is a condition; call it group" in read_manifest(path).notes[-1]
    (told,) = (x for x in read("data=manifest", f"data.manifest={path}").notes if "folds" in x)
    (override,) = shlex.split(told.partition(" give ")[2].removesuffix("."))
    assert override == 'data.test_where={split: "test"}'
    again = read("data=manifest", f"data.manifest={path}", override)
    assert not any("folds" in note for note in again.notes)
    path.write_text(path.read_text().replace("split", "fold").replace("session", "group"))
    notes = read("data=manifest", f"data.manifest={path}").notes
    assert not any("condition" in note for note in notes)


@pytest.mark.parametrize(
    ("names", "told"),
    [
        ("Oak oak elm", 1), ("oak-1 oak_1", 1), ("tile tiles", 1), ("oak old_oak elm", 0),
        ("oak|oak - Copy", 1), ("oak|oak (2)|elm", 1), ("oak oak_old elm elm_old", 2),
        ("oak_1 oak_2", 0), ("glass grass", 0),
    ],
)  # fmt: skip
def test_classes_that_may_be_one_are_told(names, told):
    labels = names.split("|" if "|" in names else None)
    rows = [Recording(label, "haptic", Path(f"{label}.wav"), label) for label in labels]
    table = with_one_spelling(Recordings(tuple(rows)))
    assert {*table.classes} == {*labels}
    assert ["are classes of their own, and" in note for note in table.notes] == [True] * told
