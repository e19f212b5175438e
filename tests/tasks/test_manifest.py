"""A manifest from names of files, through the command line, and patterns that cannot be used."""

from pathlib import Path

import numpy as np
import pytest

from tex_lightning.data.manifest import read_manifest
from tex_lightning.data.readers.path_pattern import read_names
from tex_lightning.errors import UserError


@pytest.fixture
def flat(tmp_path):
    root = tmp_path / "flat"
    root.mkdir()
    for label in ("red_oak", "pine"):
        for person in ("ann", "bob"):
            for number in range(2):
                np.save(root / f"{label}_{person}_{number}.npy", np.zeros(100))
    (root / "README.txt.bak").touch()
    np.save(root / "noise.npy", np.zeros(100))
    return root


def test_a_note_beside_recordings_is_another_name_unless_the_pattern_has_it(tmp_path):
    for name in ("oak/1", "oak/notes", "elm/1", "oak/1/summary", "elm/2/summary"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        np.save(tmp_path / f"{name}.npy", np.zeros(100))
    table, others = read_names(tmp_path, "{label}/*.npy")
    assert [row.path.parent.name for row in table] == ["elm", "oak"]
    assert "oak/notes.npy" in others
    table, _ = read_names(tmp_path, "{label}/{group}/summary.npy")
    assert [(row.label, row.group) for row in table] == [("elm", "2"), ("oak", "1")]


def test_names_become_columns_and_others_are_counted(cli, flat):
    arguments = ("task=manifest", f"data.root={flat}", "pattern={label}_{person}_{group}.npy")
    outcome = cli(*arguments)
    assert outcome.status == 0, outcome.err
    assert "8 recordings of 2 classes: pine, red_oak" in outcome.err
    assert "1 file has another name, such as noise.npy" in outcome.err
    assert list(Path.cwd().iterdir()) == []
    table = read_manifest(flat / "manifest.csv")
    assert table.classes == ["pine", "red_oak"]
    assert {row.conditions for row in table} == {(("person", "ann"),), (("person", "bob"),)}
    assert {row.group for row in table} == {0, 1}
    before = (flat / "manifest.csv").read_text()
    again = cli(*arguments)
    assert again.status == 2
    assert "exists already" in again.err
    assert (flat / "manifest.csv").read_text() == before


def test_folders_and_suffixes_tell_classes_and_senses(tmp_path):
    for label in "ab":
        (tmp_path / label / "x").mkdir(parents=True)
        for name in ("1.wav", "1.jpg", "2.wav"):
            (tmp_path / label / "x" / name).touch()
    table, others = read_names(tmp_path, "{label}/*/{day}.*")
    assert others == []
    told = [(row.label, row.modality, row.group, row.conditions) for row in table.rows[:3]]
    assert told == [
        ("a", "image", "a/x/1", (("day", "1"),)),
        ("a", "haptic", "a/x/1", (("day", "1"),)),
        ("a", "haptic", "a/x/2", (("day", "2"),)),
    ]


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        ("{label}/{group}.npy", "such as noise.npy"),
        ("{person}_{group}.npy", "has no {label}"),
        ("{label}_{label}.npy", "another name"),
        ("{label}_{a b}.npy", "one word"),
        ("{label}_{path}.npy", "neither path nor part"),
        ("{label}_{person}_{rate}.npy", ""),
        ("{label}_{rate}_{group}.npy", "no number"),
    ],
)
def test_a_pattern_that_cannot_be_used_is_refused_in_a_sentence(flat, pattern, said):
    if not said:
        assert read_names(flat, pattern)[0].rows[0].sampling_rate == 0
        return
    with pytest.raises(UserError, match=said.replace("{", r"\{").replace(".", r"\.")):
        read_names(flat, pattern)
