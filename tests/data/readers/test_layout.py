"""Folders that are not those of classes: the pattern that is told reads them as they are meant."""

import re
import shlex

import pytest
from haptic_sets import touch

from tex_lightning.data.manifest import read_manifest
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.readers.layout import advise, hint
from tex_lightning.data.readers.path_pattern import read_names
from tex_lightning.data.readers.vocabulary import rename
from tex_lightning.errors import UserError

COMMAND = re.compile(r"task=manifest (data\.root=\S+|'data\.root=[^']+') pattern='([^']+)'")


def patterns(text, root):
    """The patterns of commands in a sentence, whose folder is the one meant after a shell."""
    found = COMMAND.findall(text)
    assert {shlex.split(folder)[0] for folder, _ in found} == {f"data.root={root}"}
    return [pattern for _, pattern in found]


def read_as_told(root, text):
    """Labels and groups by each of the patterns that a sentence tells."""
    tables = [read_names(root, pattern)[0] for pattern in patterns(text, root)]
    return [sorted({f"{row.label} {row.group}" for row in table}) for table in tables]


def crossed(*levels, ending="1.wav"):
    names = [""]
    for level in levels:
        names = [f"{name}{each}/" for name in names for each in level.split()]
    return [f"{name}{end}" for name in names for end in ending.split("|")]


@pytest.mark.parametrize(
    ("files", "told"),
    [
        (crossed("s1 s2", "oak elm"), ["elm s1", "elm s2", "oak s1", "oak s2"]),
        (crossed("2024-05-01 2024-05-12", "oak elm", "haptic"),
         ["elm 2024-05-01", "elm 2024-05-12", "oak 2024-05-01", "oak 2024-05-12"]),
        (crossed("oak elm", "day1 day2"), ["elm day1", "elm day2", "oak day1", "oak day2"]),
        (crossed("oak elm", "data"), ["elm elm/data/1", "oak oak/data/1"]),
        (crossed("set", "oak elm"), ["elm set/elm/1", "oak set/oak/1"]),
        (crossed("2026", "03", "1 2", "oak elm"), ["elm 1", "elm 2", "oak 1", "oak 2"]),
        (crossed("p1 p2", "day1 day2", "oak elm"), ["elm p1", "elm p2", "oak p1", "oak p2"]),
        (crossed("oak elm", "raw filtered"), ["elm elm/raw/1", "oak oak/raw/1"]),
        (crossed("oak elm", "train test"),
         ["elm elm/test/1", "elm elm/train/1", "oak oak/test/1", "oak oak/train/1"]),
        ([f"{each}/{each}-2026-05-0{day}/1.wav" for each in ("oak", "elm") for day in "12"],
         [f"{each} {each}-2026-05-0{day}" for each in ("elm", "oak") for day in "12"]),
        (crossed("results", "elm") + crossed("s1 s2", "oak elm"),
         ["elm results", "elm s1", "elm s2", "oak s1", "oak s2"]),
    ],
)  # fmt: skip
def test_folders_that_are_told_apart(tmp_path, files, told):
    root = touch(tmp_path / "my data", *files)
    text = advise(root, [root / file for file in files])
    assert read_as_told(root, text) == [told]


@pytest.mark.parametrize(
    ("levels", "told"),
    [
        (("P1 P2", "oak elm", "1 2"), [["elm P1", "elm P2", "oak P1", "oak P2"]]),
        (("oak elm", "1 2", "7 8 9"), [["elm 1", "elm 2", "oak 1", "oak 2"]]),
        (("red_oak elm", "1 2"), [["elm 1", "elm 2", "red_oak 1", "red_oak 2"]]),
        (("oak elm", "2026-05", "1 2", "1 2"), [["elm 1", "elm 2", "oak 1", "oak 2"]]),
        (("oak elm", "1 2", "train test"), [["elm 1", "elm 2", "oak 1", "oak 2"]]),
        (("oak elm", "1 2", "P1 P2"), [["elm P1", "elm P2", "oak P1", "oak P2"]]),
        (("oak elm", "1 2", "acc photo"), [["elm 1", "elm 2", "oak 1", "oak 2"]]),
        (("oak elm", "slow fast", "1 2"),
         [["elm fast", "elm slow", "oak fast", "oak slow"],
          ["fast elm", "fast oak", "slow elm", "slow oak"]]),
        (("1 2", "3", "5 6"), [["1 5", "1 6", "2 5", "2 6"]]),
        (("c1 c2", "p1 p2", "t1 t2"), [["c1 p1", "c1 p2", "c2 p1", "c2 p2"]]),
        (("imu", "0 1", "20251106", "2115 2116"), [["0 2115", "0 2116", "1 2115", "1 2116"]]),
    ],
)  # fmt: skip
def test_parts_of_names_in_one_folder_are_told(tmp_path, levels, told):
    names = [name.rstrip("/").replace("/", "_") for name in crossed(*levels, ending="")]
    touch(tmp_path, *(f"{name}.wav" for name in names))
    with pytest.raises(UserError, match="no folder for each class: it holds") as caught:
        read_folder(tmp_path)
    assert read_as_told(tmp_path, str(caught.value)) == told


@pytest.mark.parametrize(
    ("files", "labels"),
    [
        (["set/red_oak_1.jpg", "set/elm_1.jpg"], "elm red_oak"),
        (["set/cat.0.jpg", "set/dog.0.jpg"], "cat dog"),
        ([f"set/haptic/{name}-{n}-a.csv" for name in ("oak", "elm") for n in "12"], "elm oak"),
        (crossed("set", "material_1 material_2", "anna bob"), "material_1 material_2"),
        ([*crossed("P1 P2", "day1 day2", ending="oak_1.csv"), "P1/day1/elm_1.csv"], "elm oak"),
        ([*crossed("train test", "ann bob", ending="T_red_oak_7.csv"), "train/ann/T_elm_7.csv"],
         "elm red_oak"),
        (crossed("train test", "oak elm") + crossed("train", "oak", "bad"), "elm oak"),
        (crossed("set", "C1 C2"), "C1 C2"),
        ([*crossed("haptic image other", ending="oak_1.csv"), "image/elm_1.png"], "elm oak"),
        ([*crossed("Train Val Test other", ending="oak_1.csv"), "Train/elm_1.csv"], "elm oak"),
        (["oak_1.png", "elm_1.png", *crossed("plots", ending="oak_1.png")], "elm oak"),
        (crossed("ann bob", "oak_1 elm_1", ending="day1_2.5.csv"), "elm_1 oak_1"),
        (crossed("image mask", "oak elm", ending="1.jpg"), "elm oak"),
        (crossed("set", "01 02", ending="0_01_1.wav|1_01_1.wav|0_01_2.wav|1_01_2.wav"), "0 1"),
    ],
)  # fmt: skip
def test_one_of_the_patterns_that_are_told_has_the_classes(tmp_path, files, labels):
    root = touch(tmp_path, *files)
    try:
        told = hint(str(root), read_folder(root))[0]
    except UserError as error:
        told = str(error)
    found = [{row.label for row in read_names(root, each)[0]} for each in patterns(told, root)]
    assert {*labels.split()} in found


@pytest.mark.parametrize(
    ("person", "names"),
    [
        ("P", "01_oak_9f 02_elm_9f"),
        ("run", "1.Wood-1 2.Iron-1"),
        ("v", "T_oak-1 T_oak-2 T_elm-1 T_elm-2"),
    ],
)
def test_people_read_as_classes_are_told_whatever_stands_before_the_class(tmp_path, person, names):
    files = crossed(f"{person}1 {person}2", ending="")
    root = touch(tmp_path, *(f"{each}{name}.csv" for each in files for name in names.split()))
    (note,) = read_folder(root).notes
    (told,) = read_as_told(root, note)
    assert len(told) == 4
    assert len({label.split()[0] for label in told}) == 2


@pytest.mark.parametrize("beside", [("log.csv",), ("setup.png", "map.jpg"), ("1.wav",)])
def test_a_single_class_is_read_whatever_else_lies_beside_it(tmp_path, beside):
    rows = read_folder(touch(tmp_path, "walnut/1.wav", *beside)).rows
    assert [row.label for row in rows] == ["walnut"]


def test_a_folder_that_begins_with_a_line_is_no_class(tmp_path):
    table = read_folder(touch(tmp_path, *crossed("oak elm _background_noise_")))
    assert table.classes == ["elm", "oak"]
    assert "_background_noise_ is left out" in table.notes[0]


def test_a_pattern_groups_pieces_and_takes_no_versions_nor_photos_of_signals(tmp_path):
    names = ("oak_1_seg01", "oak_1_seg02", "oak_2_seg01", "elm_1_seg01")
    root = touch(tmp_path, *(f"train/{name}.csv" for name in names), "test/oak_3_seg01.csv")
    with pytest.raises(UserError) as caught:
        read_folder(root)
    assert read_as_told(root, str(caught.value).replace("{group}", "{take}")) == [
        ["elm train/elm_1", "oak test/oak_3", "oak train/oak_1", "oak train/oak_2"]
    ]
    root = touch(tmp_path / "a", *(f"{each}_clip_{n}.wav" for each in ("oak", "elm") for n in "12"))
    table, _ = read_names(root, "{label}_clip_*.wav")
    assert len({row.group for row in table}) == 4
    assert [note[:17] for note in table.notes] == ["All files of elm,"]
    names = ("oak_1", "oak_1_filtered", "oak_1_meta", "elm_1", "elm_1_filtered")
    root = touch(tmp_path / "b", *(f"test/{name}.csv" for name in names), "test/oak_1.wav")
    table, _ = read_names(root, "{split}/{label}_{group}.*")
    assert [row.path.name for row in table] == ["elm_1.csv", "oak_1.csv", "oak_1.wav"]
    assert [note[:5] for note in table.notes] == ["2 fil", "1 rec"]
    assert [row.path.name for row in read_names(root, "test/{label}_*_meta.csv")[0]] == [
        "oak_1_meta.csv"
    ]
    root = touch(tmp_path / "c", "oak/day1/haptic/1.wav", "oak/day1/haptic/1.png")
    table, others = read_names(root, "{label}/*/{modality}/*")
    assert (len(table), others) == (1, ["oak/day1/haptic/1.png"])


def test_stars_stand_for_any_folders_or_none(tmp_path):
    files = ("elm/1.csv", "oak/s1/1.csv", "oak/s1/deep/2.csv")
    table, others = read_names(touch(tmp_path, *files, "x.csv"), "{label}/**/*.csv")
    assert [(row.label, row.path.relative_to(tmp_path).as_posix()) for row in table] == [
        (file.split("/")[0], file) for file in files
    ]
    assert others == ["x.csv"]
    table, _ = read_names(tmp_path, "{label}/{group}/**/*.csv")
    assert [row.group for row in table] == ["s1", "s1"]


@pytest.mark.parametrize(
    "files",
    [["oak/1.csv", *crossed("elm ash", "6g 10g")],
     ["oak/s1/1.csv", *crossed("elm ash", "s1 s2", "a b")],
     ["oak/1.csv", *crossed("elm", "6g"), *crossed("ash", "ball cage", "6g")]],
)  # fmt: skip
def test_classes_of_folders_of_different_depths_are_told_by_one_pattern(tmp_path, files):
    root = touch(tmp_path, *files)
    told = next(note for note in read_folder(root).notes if note.startswith("Too deep"))
    table, others = read_names(root, patterns(told, root)[0])
    assert others == []
    assert {(row.label, row.path.relative_to(root).as_posix()) for row in table} == {
        (file.split("/")[0], file) for file in files
    }


def test_a_pattern_without_a_group_tells_the_part_that_names_share(tmp_path):
    names = (f"{split}/{label}/{label}_{n}_jpg.rf.{n}{copy}.jpg" for split in ("train", "valid")
             for label in ("oak", "elm") for n in "12" for copy in "ab")  # fmt: skip
    touch(tmp_path, *names)
    (note,) = read_names(tmp_path, "{split}/{label}/*.jpg")[0].notes
    assert read_as_told(tmp_path, note) == [["elm 1", "elm 2", "oak 1", "oak 2"]]
    assert read_names(tmp_path, "{group}/{label}/*.jpg")[0].notes == ()
    assert read_names(tmp_path, "{split}/{label}/{take}.jpg")[0].notes == ()


def test_a_class_called_as_a_version_is_none(tmp_path):
    root = touch(tmp_path, "mask/1.csv", "mask/1_info.csv", "glove/1.csv")
    assert [row.path.name for row in read_folder(root)] == ["1.csv", "1.csv"]


def test_both_readings_are_told_of_folders_that_nothing_tells_apart(tmp_path):
    files = crossed("ann bob", "oak elm")
    rows = read_folder(touch(tmp_path, *files)).rows  # as senses, which no model has
    (text,) = hint(str(tmp_path), rows)
    assert text.startswith("If ann, bob are the classes, run task=manifest")
    assert read_as_told(tmp_path, text) == [
        ["ann elm", "ann oak", "bob elm", "bob oak"],
        ["elm ann", "elm bob", "oak ann", "oak bob"],
    ]
    assert hint(str(touch(tmp_path / "b", "oak/1.csv")), read_folder(tmp_path / "b")) == []
    assert hint(None, rows) == []


def test_senses_above_the_classes_are_told_with_the_pattern_that_pairs_them(tmp_path):
    files = [f"{each}/{label}/1.{end}" for label in ("oak", "elm")
             for each, end in (("Haptics", "wav"), ("sound", "wav"), ("image", "JPG"))]  # fmt: skip
    root = touch(tmp_path, *files)
    with pytest.raises(UserError, match="Haptics, image, sound in the place of classes") as caught:
        read_folder(root)
    (pattern,) = patterns(str(caught.value), root)
    table, others = read_names(root, pattern)
    assert others == []
    found = {(row.label, row.modality, row.path.relative_to(root).as_posix()) for row in table}
    senses = dict(zip(("Haptics", "sound", "image"), ("haptic", "sound", "image"), strict=True))
    assert found == {(f.split("/")[1], senses[f.split("/")[0]], f) for f in files}
    assert {(row.label, row.group) for row in table} == {("elm", "elm/1"), ("oak", "oak/1")}


@pytest.mark.parametrize("other", ["setup/fold1_train.csv", "imdb/imdb.mat", "figs/x.svg"])
def test_a_sense_beside_folders_of_other_kinds_is_no_class(tmp_path, other):
    root = touch(tmp_path, *crossed("images", "oak elm", ending="1.jpg"), other)
    with pytest.raises(UserError, match="folders images in the place of classes; if elm, oak are"):
        read_folder(root)
    rows = read_folder(touch(tmp_path / "b", *crossed("touch tap", ending="1.csv"))).rows
    assert [row.label for row in rows] == ["tap", "touch"]


def test_other_names_of_senses_are_told_as_names_and_not_as_groups(tmp_path):
    table = read_folder(touch(tmp_path, "oak/Acceleration/1.wav", "oak/photos/1.jpg"))
    assert hint(str(tmp_path), table) == []
    told = rename({"Acceleration", "photos", "thermal"})
    above = touch(tmp_path / "b", *crossed("acc photos", "oak elm"))
    with pytest.raises(UserError) as caught:
        read_folder(above)
    (pattern,) = patterns(str(caught.value), above)
    assert rename({row.modality for row in read_names(above, pattern)[0]}).startswith(" Rename acc")
    assert (
        told == " Rename Acceleration to haptic, photos to image (folders, or the column modality)."
    )
    assert rename({"thermal"}) == ""


@pytest.mark.parametrize(
    ("tops", "pattern"),
    [
        ("train test", "{split}/{label}_{group}.wav"),
        ("fold1 fold2", "{split}/{label}_{group}.wav"),
        ("haptics sound", "{modality}/{label}_{group}.wav"),
        ("haptic", "{modality}/{label}_{group}.wav"),
        ("raw filtered", "raw/{label}_{group}.wav"),
    ],
)
def test_parts_and_versions_in_the_place_of_classes_are_refused(tmp_path, tops, pattern):
    touch(tmp_path, *crossed(tops, ending="oak_1.wav"), "results/1.csv")
    with pytest.raises(UserError, match="in the place of classes; run") as caught:
        read_folder(tmp_path)
    assert patterns(str(caught.value), tmp_path) == [pattern]


def test_folders_beside_the_classes_that_are_none_are_left_out_and_told(tmp_path):
    touch(
        tmp_path,
        *crossed("oak elm results Test"),
        "Test data/1.wav",
        "code/a.py",
        "backup/oak/1.wav",
        "old/1.wav",
        "ash/1.wav",
    )
    table = read_folder(tmp_path)
    assert table.classes == ["ash", "elm", "oak"]
    left = [note.partition(" is left out")[0] for note in table.notes]
    assert left == [
        f"{tmp_path}/{name}" for name in ("Test", "Test data", "backup", "old", "results")
    ]
    assert read_folder(touch(tmp_path / "two", "oak/1.wav", "test/1.wav")).classes == [
        "oak",
        "test",
    ]
    assert read_folder(touch(tmp_path / "cloth", *crossed("hole fold stain"))).notes == ()


@pytest.mark.parametrize(
    ("names", "kept", "other"),
    [
        ("1_raw.csv 1_filtered.csv 2_raw.csv 2_filtered.csv", "1_raw.csv 2_raw.csv", "*filtered*"),
        ("1.csv 1-resampled.csv 2.csv", "1.csv 2.csv", "*resampled*"),
        ("a.jpg a_thumb.jpg b.jpg", "a.jpg b.jpg", "*thumb*"),
        ("1.wav|1 - Copy.wav|Copy of 2.wav|2.wav", "1.wav 2.wav", "*Copy*"),
        ("1.wav|Kopie von 1.wav|2.wav", "1.wav 2.wav", "*Kopie*"),
        ("1.png 1_flip.png 2.png 2_flip.png", "1.png 2.png", "*flip*"),
        ("1.png 1_HDR.png 2.png 2_HDR.png", "1.png 2.png", "*HDR*"),
        ("1.png 1_mask.png", "1.png", "*mask*"),
        ("1raw.csv 1filtered.csv aRaw.csv aEdited.csv", "1raw.csv aRaw.csv", "*filtered*"),
        ("raw_1.wav raw_2.wav", "raw_1.wav raw_2.wav", ""),
        ("1.csv 1_labels.csv 2.csv 2_labels.csv", "1.csv 2.csv", "*labels*"),
        ("1.wav 1_fft.csv", "1.wav", "*fft*"),
        ("1.wav|1 (1).wav|1 (2).wav", "1 (1).wav|1 (2).wav|1.wav", ""),
    ],
)
def test_versions_of_a_recording_are_one_recording(tmp_path, names, kept, other):
    def divided(text):
        return text.split("|" if "|" in text else None)

    touch(tmp_path, *(f"oak/{name}" for name in divided(names)))
    table = read_folder(tmp_path)
    assert sorted(row.path.name for row in table) == divided(kept)
    assert [other in note for note in table.notes] == [True] * bool(other)
    if other:
        (pattern,) = patterns(table.notes[0], tmp_path)
        taken = {row.path.name for row in read_names(tmp_path, pattern)[0]}
        assert taken == {n for n in divided(names) if other.strip("*") in n}
        everything = read_names(tmp_path, "{label}/*")[0]
        assert [row.path.name for row in everything] == [row.path.name for row in table]


def test_exports_of_a_phone_are_read_without_what_stands_beside_their_samples(tmp_path):
    files = crossed("oak elm", "9.30 9.45", ending="Raw Data.csv")
    beside = crossed("oak elm", "9.30 9.45", "meta", ending="time.csv")
    touch(tmp_path, *files, *beside, *crossed("oak elm", "9.30 9.45", ending="Metadata.csv"))
    with pytest.raises(UserError, match=r"but deeper: 8 \.csv") as caught:
        read_folder(tmp_path)
    (pattern,) = patterns(str(caught.value), tmp_path)
    table = read_names(tmp_path, pattern)[0]
    assert [row.path.relative_to(tmp_path).as_posix() for row in table] == sorted(files)


def test_files_of_one_name_in_two_formats_are_one_group(tmp_path):
    table = read_folder(touch(tmp_path, "oak/1.wav", "oak/1.csv", "oak/2.wav"))
    assert [(row.path.name, row.group) for row in table] == [
        ("1.csv", "oak/0"), ("1.wav", "oak/0"), ("2.wav", "oak/1")
    ]  # fmt: skip
    assert "1 recording is there in two formats" in table.notes[0]


def test_a_class_in_a_folder_of_its_own_name_is_read(tmp_path):
    table = read_folder(touch(tmp_path, "oak/Oak/1.wav", "oak/.DS_Store", "elm/1.wav"))
    assert [(row.label, row.path.name) for row in table] == [("elm", "1.wav"), ("oak", "1.wav")]
    assert table.notes == ()


@pytest.mark.parametrize(
    ("files", "told"),
    [
        (crossed("oak_1 oak_2 elm_1 elm_2", "haptic"), ["elm 1", "elm 2", "oak 1", "oak 2"]),
        (crossed("P1 P2", ending="oak_1.wav") + crossed("P1 P2", ending="elm_1.wav"),
         ["elm P1", "elm P2", "oak P1", "oak P2"]),
        (crossed("ann bob", ending="oak-1.wav") + crossed("ann bob", ending="elm-1.wav")
         + crossed("ann bob", ending="oak-2.wav") + crossed("ann bob", ending="elm-2.wav"),
         ["elm ann", "elm bob", "oak ann", "oak bob"]),
        (crossed("oak1 oak12 elm1 elm3"), ["elm 1", "elm 3", "oak 1", "oak 12"]),
        (crossed("oak-day1 oak-day2 elm-day1 elm-day2"), ["elm 1", "elm 2", "oak 1", "oak 2"]),
        (crossed("ann bob", ending="oak.wav") + crossed("ann bob", ending="elm.wav"),
         ["elm ann", "elm bob", "oak ann", "oak bob"]),
        (crossed("Session.1 Session.2 Session.3", ending="oak.wav|elm.wav"),
         ["elm Session.1", "elm Session.2", "elm Session.3",
          "oak Session.1", "oak Session.2", "oak Session.3"]),
        (crossed("oak_1 oak_2 elm_7 elm_8", ending="sub_1.csv|sub_2.csv"),
         ["elm sub_1", "elm sub_2", "oak sub_1", "oak sub_2"]),
        (crossed("Actor_01 Actor_02", ending="03-01-1.wav|03-01-2.wav|03-05-1.wav|03-05-2.wav"),
         ["01 Actor_01", "01 Actor_02", "05 Actor_01", "05 Actor_02"]),
        (crossed("oak_front oak_back elm_front elm_back"),
         ["elm back", "elm front", "oak back", "oak front"]),
        (crossed("oak_front oak_back elm_front ash_dry"), None),
        (crossed("oak_1 elm_2"), None),
        (crossed("Version1 Version2"), None),
        (crossed("oak_1 oak_2 ash"), None),
    ],
)  # fmt: skip
def test_classes_that_may_be_sessions_are_told(tmp_path, files, told):
    notes = read_folder(touch(tmp_path, *files)).notes
    assert [read_as_told(tmp_path, note)[0] for note in notes][:1] == ([told] if told else [])


def test_either_part_of_classes_that_are_crossed_may_be_the_class(tmp_path):
    (note,) = read_folder(touch(tmp_path, *crossed("ann_oak ann_elm bob_oak bob_elm"))).notes
    people = ["ann elm", "ann oak", "bob elm", "bob oak"]
    assert read_as_told(tmp_path, note) == [people, ["elm ann", "elm bob", "oak ann", "oak bob"]]
    (note,) = read_folder(
        touch(tmp_path / "b", *crossed("red_oak_wet red_oak_dry elm_wet elm_dry"))
    ).notes
    assert len(read_as_told(tmp_path / "b", note)) == 1


def test_numbers_behind_classes_of_sensors_are_groups(tmp_path):
    files = crossed("oak_1 oak_2 elm_1 elm_2", ending="acc.csv|gyro.csv")
    with pytest.raises(UserError, match="of two sensors") as caught:
        read_folder(touch(tmp_path, *files))
    assert read_as_told(tmp_path, str(caught.value))[0] == ["elm 1", "elm 2", "oak 1", "oak 2"]


@pytest.mark.parametrize(
    ("names", "groups"),
    [
        *((" ".join(f"{n}{mark}{end}" for n in "12" for end in ends.split()), "1 2")
          for mark in "_-" for ends in ("left right", "L R", "pac pdc tac", "nir noflash rgb")),
        ("1_left 1_right 2_left", "1 2"),
        ("1_v1 1_v2 2_v1 2_v2", "1 2"),
        ("ann_1 ann_2 bob_1 bob_2", "ann bob"),
        ("CLASS_S01_1 CLASS_S01_2 CLASS_S02_1 CLASS_S02_2", "S01 S02"),
        ("30_CLASS_1_P1 60_CLASS_1_P1 30_CLASS_2_P2 60_CLASS_2_P2", "P1 P2"),
        ("0a7c2a8d_nohash_0 0a7c2a8d_nohash_1 0ab3b47d_nohash_0 0ab3b47d_nohash_1",
         "0a7c2a8d 0ab3b47d"),
        ("CLASS 2024-05-01 1|CLASS 2024-05-01 2|CLASS 2024-06-01 1|CLASS 2024-06-01 2",
         "2024-05-01 2024-06-01"),
        ("CLASS_1_jpg.rf.0a CLASS_1_jpg.rf.1b CLASS_2_jpg.rf.2c CLASS_2_jpg.rf.3d", "1 2"),
    ],
)  # fmt: skip
def test_a_part_that_names_of_a_class_share_may_be_a_person_or_recording(tmp_path, names, groups):
    divided = names.split("|" if "|" in names else None)
    files = (f"{label}/haptic/{name.replace('CLASS', label)}.wav"
             for label in ("red_oak", "elm") for name in divided)  # fmt: skip
    note = read_folder(touch(tmp_path, *files)).notes[-1]
    assert f" share {', '.join(groups.split())} in their names, and are" in note
    expected = [f"{label} {group}" for label in ("elm", "red_oak") for group in groups.split()]
    assert read_as_told(tmp_path, note) == [expected]


def test_people_who_are_not_in_all_classes_are_told(tmp_path):
    files = ("walk/S01.csv", "walk/S02.csv", "run/S01.csv", "sit/S02.csv", "sit/S01.csv")
    (note,) = read_folder(touch(tmp_path, *files)).notes
    assert read_as_told(tmp_path, note) == [
        ["run S01", "sit S01", "sit S02", "walk S01", "walk S02"]
    ]
    assert read_folder(touch(tmp_path, "run/S02.csv")).notes == ()  # folds take the n-th of each


def test_a_few_files_of_other_names_hide_no_part_that_the_others_share(tmp_path):
    names = [f"S0{person}_{take}" for person in (1, 2, 3) for take in (1, 2, 3, 4)]
    touch(
        tmp_path,
        *(f"{label}/{name}.csv" for label in ("oak", "elm") for name in names),
        "oak/x.csv",
    )
    (note,) = read_folder(tmp_path).notes
    assert "share S01, S02, S03 in their names" in note
    assert len(read_as_told(tmp_path, note)[0]) == 6


@pytest.mark.parametrize(
    "names",
    ["1 2 3", "CLASS_1 CLASS_2 CLASS_3", "P1_1 P2_2 P3_3", "30mms_1 30mms_2 60mms_1 60mms_2",
     "take_1 take_2 take_3", "r1_seg1 r1_seg2 r2_seg1", "a_left a_right"],
)  # fmt: skip
def test_names_that_share_no_part_or_a_condition_are_not_told(tmp_path, names):
    files = (f"{label}/{name.replace('CLASS', label)}.wav"
             for label in ("oak", "elm") for name in names.split())  # fmt: skip
    assert not [each for each in read_folder(touch(tmp_path, *files)).notes if " share " in each]


@pytest.mark.parametrize(
    "form", ["oak/train{}.wav oak/test{}.wav", "elm/elm_Train_{} elm/elm_val_{}"]
)
def test_parts_in_the_names_of_files_are_told(tmp_path, form):
    files = " ".join(form.format(n, n).replace(".wav", "") for n in "12").split()
    touch(tmp_path, *(f"{file}.wav" for file in files))
    note = read_folder(tmp_path).notes[-1]
    assert re.match(r"The names of files have (test|train), (train|val), which folds do no", note)
    assert read_folder(touch(tmp_path, f"{files[0]}/../other.wav")).notes == ()


def test_lists_of_what_is_trained_on_and_tested_are_told(tmp_path):
    root = touch(tmp_path, "img/oak/1.jpg", "img/elm/2.jpg", "train.txt", "test/x.txt")
    (root / "notes.txt").write_text("oak/1.jpg\n")
    (root / "test_about.txt").write_text("/ is the root, see oak/1.jpg\n")
    assert read_folder(root / "img").notes == read_names(root, "*/{label}/*.jpg")[0].notes == ()
    (root / "testing_list.txt").write_text("oak/1.jpg 0\n")
    (note,) = read_names(root, "*/{label}/*.jpg")[0].notes
    assert note.startswith("testing_list.txt names recordings to train or test on, which folds do")
    (root / "labels").mkdir()
    (root / "labels" / "val1.txt").write_text("img/elm/2\n")
    (note,) = read_names(root, "*/{label}/*.jpg")[0].notes
    assert note.startswith("testing_list.txt and 1 more list name recordings to train or test on")
    root = touch(tmp_path / "b", "oak/1.jpg", "elm/2.jpg")
    (root / "validation.txt").write_text("elm/2\n")
    assert [each[:20] for each in read_folder(root).notes] == ["validation.txt names"]


@pytest.mark.parametrize(
    ("files", "told"),
    [
        ("oak/1.wav elm/1.csv elm/2.txt", "traces of elm are .csv and those of oak .wav, which"),
        ("oak/1.jpg oak/2.jpeg elm/1.png", "photos of elm are .png and those of oak .jpg"),
        ("oak/1.jpg oak/2.png elm/1.png", ""), ("oak/1.txt elm/1.csv elm/1.png", ""),
    ],
)  # fmt: skip
def test_classes_of_different_kinds_of_files_are_told(tmp_path, files, told):
    notes = read_folder(touch(tmp_path, *files.split())).notes
    assert [told in note for note in notes] == [True] * bool(told)


@pytest.mark.parametrize("inside", ["oak_1.csv", "oak/1.csv"])
@pytest.mark.parametrize("sensors", ["Accel Gyro", "Gyroscope Magnetometer", "ft imu"])
def test_folders_of_sensors_in_the_place_of_classes_are_refused(tmp_path, sensors, inside):
    files = [f"{sensor}/{inside.replace('1', n)}" for sensor in sensors.split() for n in "12"]
    said = (
        f"folders {', '.join(sensors.split())} of sensors in .* data.root={tmp_path}/{sensors[:2]}"
    )
    with pytest.raises(UserError, match=said):
        read_folder(touch(tmp_path, *files))
    assert len(read_folder(touch(tmp_path, "oak/1.csv"))) >= 1


LABELS = 'File;Material\n"1";oak\n2.wav;elm\n'


def test_a_table_of_labels_is_told_and_read(tmp_path):
    root = touch(tmp_path, "data/1.wav", "data/2.wav")
    (root / "labels.csv").write_text(LABELS)
    (text,) = hint(str(root), read_folder(root))
    command = f"data=manifest data.manifest={root}/labels.csv"
    assert text == f"The table labels.csv names recordings and their classes; {command} reads it."
    assert (
        "Classes are the names of folders, but the table labels.csv" in read_folder(root).notes[0]
    )
    table = read_manifest(root / "labels.csv")
    assert [(row.label, row.modality, row.path.name, row.group) for row in table] == [
        ("oak", "haptic", "1.wav", 1), ("elm", "haptic", "2.wav", 2)
    ]  # fmt: skip
    assert ["no column modality" in table.notes[0], "no column group" in table.notes[1]] == [
        True
    ] * 2
    touch(root, "1.wav")
    assert read_manifest(root / "labels.csv").rows[0].path.name == "1"  # two have that name
    flat = touch(tmp_path / "flat", "1.wav", "2.wav")
    (flat / "labels.csv").write_text(LABELS)
    with pytest.raises(UserError, match="no folder for each class, but the table labels"):
        read_folder(flat)


@pytest.mark.parametrize("name", ["scene_label", "Activity", "terrain class", "Surface Material"])
def test_columns_of_labels_have_names_with_more_words(tmp_path, name):
    touch(tmp_path, "1.wav", "2.wav")
    (tmp_path / "all.csv").write_text(LABELS.replace("Material", name))
    with pytest.raises(UserError, match="no folder for each class, but the table all"):
        read_folder(tmp_path)
    assert read_manifest(tmp_path / "all.csv").classes == ["elm", "oak"]
    (tmp_path / "all.csv").write_text(f"file;sublabel;{name}\n1.wav;a;oak\n")
    with pytest.raises(UserError, match="has no column label"):
        read_manifest(tmp_path / "all.csv")


@pytest.mark.parametrize("folder", ["audio", "audio/fold1"])
def test_a_table_in_a_folder_of_its_own_is_told_and_read(tmp_path, folder):
    root = touch(tmp_path, f"{folder}/1.wav", f"{folder}/2.wav", "meta/table.csv")
    (root / "meta" / "table.csv").write_text(LABELS.replace("file", "slice_file_name"))
    with pytest.raises(UserError, match=r"data\.manifest=\S+/meta/table\.csv reads it"):
        read_folder(root)
    table = read_manifest(root / "meta" / "table.csv")
    assert [row.path for row in table] == [root / folder / "1.wav", root / folder / "2.wav"]


def test_a_table_that_agrees_with_the_folders_is_not_told(tmp_path):
    root = touch(tmp_path, "oak/1.wav", "elm/2.wav")
    (root / "labels.csv").write_text(LABELS)
    (root / "huge.txt").write_text("file,label\n" + "x" * 2_000_000)
    assert read_folder(root).notes == ()


def test_flat_files_are_told_by_the_mark_that_all_names_have(tmp_path):
    close = touch(tmp_path / "close", "oak01.wav", "oak12.wav", "elm3.wav")
    with pytest.raises(UserError, match="pattern=") as caught:
        read_folder(close)
    assert read_as_told(close, str(caught.value)) == [["elm 3", "oak 01", "oak 12"]]
    with pytest.raises(UserError, match=r"pattern='\{label\}-\{group\}\.wav', and train"):
        read_folder(touch(tmp_path / "b", "red_oak-1.wav", "elm-1.wav", "README.txt"))


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (["all.csv"], "write the samples of each recording into a table of its own"),
        (["X_train.csv", "y_train.csv"], "LABEL/haptic/NUMBER.csv"),
        (["oak_1.csv", "oak_2.csv", "elm_1.csv", "elm_2.csv"], r"pattern='{label}_{group}.csv'"),
        (["X.npy", "Y.npy"], "write each row of X"),
        (["X_train.csv", "y_train.csv", "X_test.csv", "s.csv"], "apart, X_train.csv and y_train"),
        (
            ["train/X_train.txt", "train/y_train.txt", "train/a/x.txt", "test/X_test.txt"],
            "apart, train/X_train.txt",
        ),
        (["a_TRAIN.ts", "a_TEST.ts"], "Write the samples of each recording"),
        (["oak/1.json", "elm/1.json"], r"2 \.json .*Write the samples of each recording"),
        (["1st/2003.10.22.12", "2nd/2003.10.22.13"], "Rename what is a table of numbers in text"),
        (
            ["all.csv", "calls/owl/1.ogg"],
            r"in one file\). Of other kinds and not read: 1 \.ogg .* Convert other sound",
        ),
        (
            [f"raw/{sensor}_exp{n}_user{n}.txt" for sensor in ("acc", "gyro") for n in "12"],
            "choose a sensor: give their classes in a manifest",
        ),
        (["oak.npy", "elm.npy", "ash.npy"], "3 .npy .*; give their classes in a manifest"),
        (["001.csv", "002.csv", "003.csv", "004.csv"], "; give their classes in a manifest"),
    ],
)
def test_all_recordings_in_one_file_are_told_how_they_become_files(tmp_path, files, said):
    with pytest.raises(UserError, match=said):
        read_folder(touch(tmp_path, *files))


def test_folders_of_versions_below_a_star_are_versions_too(tmp_path):
    root = touch(tmp_path, *crossed("oak elm", "raw filtered"))
    table, _ = read_names(root, "{label}/*/{group}.wav")
    assert {row.path.parent.name for row in table} == {"raw"}
    (pattern,) = patterns(table.notes[0], root)
    assert {row.path.parent.name for row in read_names(root, pattern)[0]} == {"filtered"}


def test_a_stroke_and_a_photo_in_folders_of_senses_alone_are_a_group(tmp_path):
    root = touch(
        tmp_path, "haptic/oak_1.wav", "haptic/elm_1.wav", "image/oak_1.jpg", "image/elm_1.jpg"
    )
    with pytest.raises(UserError) as caught:
        read_folder(root)
    (pattern,) = patterns(str(caught.value), root)
    table, _ = read_names(root, pattern)
    assert sorted((row.label, row.modality, row.group) for row in table) == [
        ("elm", "haptic", "1"), ("elm", "image", "1"), ("oak", "haptic", "1"), ("oak", "image", "1")
    ]  # fmt: skip
