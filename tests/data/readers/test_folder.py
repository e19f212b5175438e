"""Folders as people lay them out: names in any case, flat classes, files beside folders."""

import shutil

import numpy as np

from tex_lightning.data.readers.folder import read_folder


def touch(root, *names):
    for name in names:
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x")
    return root


def names(rows, modality):
    return [row.path.name for row in rows.of(modality)]


def test_folders_are_found_in_any_case_and_in_the_plural(tmp_path):
    root = touch(tmp_path, "a/Haptic/1.wav", "a/IMAGES/1.jpg", "b/haptics/2.npy", "b/image/2.png")
    rows = read_folder(root)
    assert names(rows, "haptic") == ["1.wav", "2.npy"]
    assert names(rows, "image") == ["1.jpg", "2.png"]
    assert rows.notes == ()
    touch(root, "a/haptics/3.wav")
    assert names(read_folder(root), "haptic") == ["1.wav", "3.wav", "2.npy"]


def test_sounds_and_senses_of_the_users_own_are_read_from_their_folders(tmp_path):
    root = touch(tmp_path, "a/Sounds/1.wav", "a/haptic/1.wav", "a/thermal/1.png")
    touch(root, "a/Radar/2.npy", "a/raw data/1.wav", "a/notes/read.me", "a/Sounds/cover.jpg")
    rows = read_folder(root)
    found = [(row.modality, row.path.name, row.group) for row in rows]
    assert sorted(found) == [
        ("haptic", "1.wav", 0),
        ("radar", "2.npy", 0),
        ("sound", "1.wav", 0),
        ("thermal", "1.png", 0),
    ]


def test_a_flat_class_is_read_by_the_suffixes_of_its_files(tmp_path):
    root = touch(tmp_path, "a/s10.wav", "a/s9.wav", "a/p1.JPG", "a/s9.json")
    touch(root, "b/haptic/1.wav", ".git/x.wav")
    rows = read_folder(root)
    assert rows.classes == ["a", "b"]
    flat = [(row.path.name, row.modality, row.group) for row in rows.in_classes(["a"])]
    assert flat == [("s9.wav", "haptic", 0), ("s10.wav", "haptic", 1), ("p1.JPG", "image", 0)]
    assert rows.notes == ()


def test_folders_win_over_files_beside_them_which_are_named(tmp_path):
    root = touch(tmp_path, "a/haptic/1.wav", "a/2.wav", "a/3.jpg", "a/notes.docx")
    rows = read_folder(root)
    assert names(rows, "haptic") == ["1.wav"]
    assert not rows.of("image")
    (note,) = rows.notes
    assert (note.what, note.count) == ("stray file", 2)
    assert "2.wav beside them is not read" in note.text


def test_a_folder_of_anything_else_does_not_keep_files_from_being_read(tmp_path):
    rows = read_folder(touch(tmp_path, "a/1.wav", "a/old/1.wav", "b/force/1.npy"))
    assert names(rows, "haptic") == ["1.wav"]
    assert [row.label for row in rows.of("force")] == ["b"]
    assert not rows.notes


def test_classes_without_anything_readable_are_named(tmp_path):
    root = touch(tmp_path, "a/haptic/1.wav", "a/image/1.heic", "b/x.doc")
    (root / "c" / "haptic").mkdir(parents=True)
    rows = read_folder(root)
    assert rows.classes == ["a"]
    assert [note.text.partition(" is skipped")[0][-1] for note in rows.notes] == ["b", "c"]


def test_two_axes_of_three_stay_one_recording(tmp_path, surfaces):
    folder = shutil.copytree(surfaces / "alpha" / "haptic", tmp_path / "a" / "haptic")
    for axis in "YZ":
        np.savetxt(folder / f"alpha_{axis}_5.txt", np.ones(9))
    rows = read_folder(tmp_path)
    assert len(rows) == 11
    assert sum("Y" in row.path.name for row in rows) == 1
