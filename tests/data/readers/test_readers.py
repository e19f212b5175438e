"""Readers of one's own data and of synthetic surfaces."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from haptic_sets import read, touch

from tex_lightning.data.manifest import read_manifest, write_manifest
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.readers.path_pattern import read_names
from tex_lightning.data.recordings import Recordings
from tex_lightning.errors import UserError
from tex_lightning.studies.dataset import hold_out
from tex_lightning_runtime.files import require_file

OTHERS = "Of other kinds and not read: "


@pytest.mark.parametrize(
    ("files", "expected", "notes"),
    [
        pytest.param(
            ["a/Haptic/1.wav", "a/haptics/3.wav", "a/IMAGES/1.jpg", "a/haptic/.hidden.wav",
             "a/haptic /4.wav", "a/Image data/2.jpg"],
            ["a haptic 0 1.wav", "a haptic 1 3.wav", "a haptic 2 4.wav", "a image 0 1.jpg",
             "a image 1 2.jpg"],
            [],
            id="any case, in the plural",
        ),
        pytest.param(
            ["a/Sounds/1.wav", "a/thermal/1.png", "a/Radar/2.npy", "a/raw data/1.wav",
             "a/notes/read.me", "a/Sounds/cover.jpg"],
            ["a radar 0 2.npy", "a sound 0 1.wav", "a thermal 0 1.png"],
            [f"{OTHERS}1 .jpg, 1 .me, 1 .wav (such as DIR/a/Sounds/cover.jpg)."],
            id="sounds and senses of the user's own",
        ),
        pytest.param(
            ["a/s10.wav", "a/s9.wav", "a/p1.JPG", "a/p2.jfif", "a/s9.json", "a/old/1.wav",
             ".git/x.wav"],
            ["a haptic 0 s9.wav", "a haptic 1 s10.wav", "a image 0 p1.JPG", "a image 1 p2.jfif",
             "a old 0 1.wav"],
            [f"{OTHERS}1 .json (such as DIR/a/s9.json)."],
            id="a flat class by suffixes",
        ),
        pytest.param(
            ["a/haptic/1.wav", "a/2.wav", "a/3.jpg", "a/notes.docx"],
            ["a haptic 0 1.wav"],
            ["DIR/a has folders for its senses, so 2.wav beside them is not read.",
             f"{OTHERS}1 .docx (such as DIR/a/notes.docx)."],
            id="folders win over files beside them",
        ),
        pytest.param(
            ["a/haptic/1.wav", "a/image/1.heic", "b/x.doc", "notes.txt"],
            ["a haptic 0 1.wav"],
            ["Class folder DIR/b is skipped: it has no trace and no photo.",
             f"{OTHERS}1 .heic, 1 .doc (such as DIR/a/image/1.heic). "
             "Convert the photos to .jpg or .png."],
            id="classes without anything readable",
        ),
    ],
)  # fmt: skip
def test_folders_as_people_lay_them_out(tmp_path, files, expected, notes):
    rows = read_folder(touch(tmp_path, *files))
    places = [row.group.removeprefix(f"{row.label}/") for row in rows]
    described = [
        f"{row.label} {row.modality} {place} {row.path.name}"
        for row, place in zip(rows, places, strict=True)
    ]
    assert sorted(described) == expected
    assert [note.replace(str(tmp_path), "DIR") for note in rows.notes] == notes


@pytest.mark.parametrize(
    ("file", "pattern"),
    [
        ("a/day 1/1.csv", "{label}/{group}/*.csv"),
        ("a/day 1/Haptics/1.csv", "{label}/{group}/{modality}/*.csv"),
        ("a/haptic/day 1/1.csv", "{label}/{modality}/{group}/*.csv"),
    ],
)
def test_recordings_that_lie_too_deep_are_told_with_the_pattern_that_reads_them(
    tmp_path, file, pattern
):
    touch(tmp_path, file, file.replace("1.csv", "2.csv"), file.replace("1.csv", "~$2.csv"))
    with pytest.raises(UserError, match=f"but deeper: 2 .csv .* pattern='{re.escape(pattern)}'"):
        read_folder(tmp_path)
    table, others = read_names(tmp_path, pattern)
    assert ({(row.label, row.modality, row.group) for row in table}, len(table)) == (
        {("a", "haptic", "day 1")}, 2
    )  # fmt: skip
    assert others == []
    (note,) = read_folder(touch(tmp_path, "b/haptic/1.csv")).notes
    assert note.startswith("Too deep and not read: 2 .csv (such as ")


def test_two_axes_of_three_stay_one_recording(tmp_path):
    touch(tmp_path, "a/haptic/1.wav")
    for axis in "YZ":
        np.savetxt(tmp_path / "a" / "haptic" / f"alpha_{axis}_5.txt", np.ones(9))
    assert [row.path.name for row in read_folder(tmp_path)] == ["1.wav", "alpha_Y_5.txt"]


@pytest.mark.parametrize(
    ("one", "other", "pattern"),
    [
        ("a/1_acc.csv", "a/1_gyro.csv", "{label}/*acc*.csv"),
        ("a/haptic/Acc1.csv", "a/haptic/Gyroscope1.csv", "{label}/{modality}/*Acc*.csv"),
        ("a/image/1_rgb.png", "a/image/1_depth.png", "{label}/{modality}/*depth*.png"),
        ("a/imu_1.csv", "a/pro_1.csv", "{label}/*imu*.csv"),
        ("a/1_ch1.csv", "a/1_ch2.csv", "{label}/*ch1*.csv"),
        ("a/1_imu.csv", "a/1_audio.wav", "{label}/*audio*.wav"),
        ("a/1_ACC.txt", "a/1_ECG.txt", "{label}/*ACC*.txt"),
    ],
)
def test_files_of_two_sensors_are_no_two_recordings(tmp_path, one, other, pattern):
    touch(tmp_path, *(name.replace("1", n, 1) for name in (one, other) for n in "12"))
    with pytest.raises(UserError, match=f"of two sensors .*pattern='{re.escape(pattern)}'"):
        read_folder(tmp_path)
    table, _ = read_names(tmp_path, pattern)
    assert len(table) == len({row.group for row in table}) == 2
    with pytest.raises(UserError, match="of two sensors"):
        read_names(tmp_path, "{label}/*" if one.count("/") == 1 else "{label}/*/*")


def test_a_number_behind_a_sensor_may_be_that_of_a_recording(tmp_path):
    touch(tmp_path, "a/sensor1.wav", "a/sensor2.wav", "b/sensor1.wav", "b/imu_1.csv", "b/imu_2.csv")
    assert len(read_folder(tmp_path)) == 5


def test_recordings_beside_the_classes_are_told_and_tables_are_not(tmp_path):
    touch(tmp_path, "oak/1.wav", "elm/1.wav", "elm.JPG", "people.csv", "README.txt")
    (note,) = read_folder(tmp_path).notes
    assert note.startswith("Beside the folders of classes and not read: 1 .jpg (such as ")


def test_pieces_of_a_recording_are_a_group(tmp_path):
    names = ("r1_seg01", "r1_seg02", "r2_seg01", "r2_seg10", "r3")
    touch(tmp_path, *(f"oak/{name}.wav" for name in names), "elm/clip-1.wav", "elm/clip-2.wav")
    table = read_folder(tmp_path)
    groups = [(row.path.stem, row.group) for row in table if row.label == "oak"]
    assert groups == [*zip(names, ("oak/0", "oak/0", "oak/1", "oak/1", "oak/2"), strict=True)]
    assert len({row.group for row in table if row.label == "elm"}) == 2
    assert [note.partition(" by their")[0] for note in table.notes] == [
        "4 files are pieces of 2 recordings"
    ]
    touch(tmp_path / "two", "oak/a_frame1.png", "oak/a_frame2.png", "oak/b.png", "oak/b_rot90.png")
    touch(tmp_path / "two", "oak/b_BURST002.png")
    assert len({row.group for row in read_folder(tmp_path / "two")}) == 2
    touch(tmp_path / "one", "oak/cut_part1.wav", "oak/cut_part2.wav", "elm/1.wav")
    table = read_folder(tmp_path / "one")
    assert len({row.group for row in table}) == 3
    assert table.notes[0].startswith("All files of oak are pieces of one recording")


def test_folders_of_systems_and_links_to_themselves_are_no_classes(tmp_path):
    touch(tmp_path, "oak/1.wav", "$RECYCLE.BIN/1.wav", "System Volume Information/1.wav")
    touch(tmp_path, "elm/1.wav", "@eaDir/1.wav", "lost+found/1.wav")
    (tmp_path / "elm" / "2.wav").symlink_to(tmp_path / "elm" / "2.wav")
    (tmp_path / "elm" / "all").symlink_to(tmp_path)
    table = read_folder(tmp_path)
    assert table.classes == ["elm", "oak"]
    with pytest.raises(UserError, match=r"2\.wav is a folder, a device, a pipe or a broken link"):
        require_file(table.of("haptic").rows[1].path)


def test_a_phones_description_beside_its_samples_is_not_told_as_recordings(tmp_path):
    files = ("Raw Data.csv", "meta/device.csv", "meta/time.csv")
    touch(tmp_path, *(f"oak/{place}/{file}" for place in ("rec1", "rec2") for file in files))
    table = read_folder(tmp_path)
    assert ([row.path.name for row in table], table.notes) == (["Raw Data.csv"] * 2, ())


def test_archives_are_to_be_unpacked(tmp_path):
    with pytest.raises(UserError, match=r"holds no rec.*, …\)\. Unpack archives"):
        read_folder(touch(tmp_path / "a", "oak.zip"))
    with pytest.raises(UserError, match=r"oak.zip is a file; give an existing folder"):
        read_folder(tmp_path / "a" / "oak.zip")


def test_a_folder_of_other_kinds_alone_says_what_is_there(tmp_path):
    touch(tmp_path, *(f"{label}/haptic/{n}.mp3" for label in "ab" for n in range(3)), "a/Thumbs.db")
    with pytest.raises(UserError, match=rf"holds no rec.* {OTHERS}6 \.mp3 \(.*Convert other so"):
        read_folder(tmp_path)


def test_parts_in_the_place_of_classes_are_told_with_the_pattern_that_reads_them(tmp_path):
    touch(tmp_path, *(f"{part}/oak/1.csv" for part in ("Train", "val", "test")))
    with pytest.raises(UserError, match=r"Train, test, val in the place of classes; run task=man"):
        read_folder(tmp_path)


def test_a_text_about_recordings_is_none(tmp_path):
    touch(tmp_path, "a/1.csv", "a/README.txt", "b/haptic/1.csv", "b/haptic/readme.txt")
    touch(
        tmp_path, "a/metadata.csv", "b/haptic/info.csv", "a/calibration.csv", "b/haptic/labels.csv"
    )
    table = read_folder(tmp_path)
    assert [row.path.name for row in table] == ["1.csv", "1.csv"]
    assert [note.partition(" (")[0] for note in table.notes] == [f"{OTHERS}4 .csv, 2 .txt"]


def test_spellings_that_look_alike_are_one_class(tmp_path):
    names = ["Gr\u00fcn", "Gru\u0308n", "oak", "oak ", "pine\u00a0"]
    touch(tmp_path, *(f"{name}/haptic/{n}.wav" for name in names for n in range(2)))
    rows = read("data=folder", f'data.root="{tmp_path}"')
    assert rows.classes == ["Gr\u00fcn", "oak", "pine"]
    assert [row.label for row in rows].count("oak") == 4
    grouped = {row.group for row in rows if row.label == "Gr\u00fcn"}
    assert len(grouped) == 2  # what has one name was recorded together, as far as is known
    assert rows.notes == (
        "'Gru\\u0308n' and 'Gr\\xfcn' look alike and are one class, Gr\u00fcn.",
        "'oak' and 'oak ' look alike and are one class, oak.",
    )
    held, unknown = hold_out(rows, ["Gru\u0308n"])
    assert (held.classes, unknown.classes) == (["oak", "pine"], ["Gr\u00fcn"])


def test_too_few_recordings_or_classes_are_refused(surfaces, tmp_path):
    common = ["data=folder", f"data.root={surfaces}"]
    assert read(*common, "data.classes=2").classes == ["alpha", "beta"]
    with pytest.raises(UserError, match="asks for 4 classes, but the data has 3"):
        read(*common, "data.classes=4")
    with pytest.raises(UserError, match="holds no recordings; put traces in"):
        read("data=folder", f"data.root={tmp_path}")
    touch(tmp_path, "one/alpha/1.wav")
    with pytest.raises(UserError, match="only the class alpha"):
        read("data=folder", f"data.root={tmp_path}/one")


def test_a_manifest_gives_the_same_table_as_the_folder(surfaces, tmp_path):
    rows = read("data=folder", f"data.root={surfaces}")
    assert len(rows.of("haptic")) == len(rows.of("image")) == 30
    write_manifest(rows, tmp_path / "m.csv")
    again = read("data=manifest", f"data.manifest={tmp_path}/m.csv")
    assert set(again.rows) == {replace(row, path=row.path.resolve()) for row in rows}
    assert read_manifest(str(tmp_path / "m.csv")) == again
    assert read_folder(str(surfaces)).rows == read_folder(surfaces).rows


SMALL = "data.synthetic={recordings: 2, seconds: 1, photo_width: 64, photo_height: 48}"


def small(cache: Path, *overrides: str, **more: list[str]) -> Recordings:
    return read("data.classes=2", SMALL, f"data.cache_dir={cache}", *overrides, **more)


def test_synthetic_is_rendered_once_and_survives_in_the_cache(cache, monkeypatch):
    first = small(cache)
    assert len(first) == 8
    monkeypatch.setattr("tex_lightning.data.readers.synthetic.write_folder", None)
    assert small(cache) == first


def test_sounds_are_rendered_for_models_that_listen_and_beside_the_rest(tmp_path, monkeypatch):
    def write(classes, surfaces, root, modalities):
        for label in "ab"[:classes]:
            for modality in modalities:
                suffix = "jpg" if modality == "image" else "wav"
                touch(root, *(f"{label}/{modality}/{n}.{suffix}" for n in range(2)))

    monkeypatch.setattr("tex_lightning.data.readers.synthetic.write_folder", write)
    silent = small(tmp_path, "model=fusion")
    assert {row.modality for row in silent} == {"haptic", "image"}
    every = small(tmp_path, "model.senses=[haptic,visual,sound]")
    assert every.without(every.of("sound")) == silent
    assert len(every.of("sound")) == 4
    alone = small(tmp_path, modalities=["sound"])
    assert {row.modality for row in alone} == {"sound"}


def test_generated_surfaces_are_listed_in_a_manifest(cli, tmp_path):
    keys = ["task=generate", "data.classes=2", SMALL, f"generate.out={tmp_path}/out"]
    written = cli(*keys, "generate.sound=true", f"hydra.run.dir={tmp_path}/run")
    assert written.status == 0, written.err
    rows = read_manifest(tmp_path / "out" / "manifest.csv")
    assert [len(rows.of(sense)) for sense in ("haptic", "image", "sound")] == [4, 4, 4]
    again = cli(*keys, f"hydra.run.dir={tmp_path}/again")
    assert again.status == 2
    assert "is not empty; name a new folder" in again.err
