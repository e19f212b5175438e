"""Readers of published data sets, on small files under their real names."""

import shutil
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import make_trace
from haptic_sets import RATE, STROKES, SURFACES, read, tone, write_cluster, write_tum
from PIL import Image

from tex_lightning.data.decode import SignalDecoder
from tex_lightning.errors import UserError


def write_image(path: Path, seed: int, *size: int) -> None:
    """Grey noise, so that no two files are alike; ``size`` is height and width."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, size, dtype=np.uint8)
    Image.fromarray(pixels).save(path, **({"compress_level": 1} if path.suffix == ".png" else {}))


def write_lmt108(root: Path, samples: int, *size: int) -> Path:
    """Two classes of both halves; of the training half sounds and taps in one file each."""
    for kind, label in enumerate(("G1AluminiumMesh", "G2Brick")):
        for mark, split in (("train", "Training"), ("test", "Testing")):
            for n in range(1, 11):
                axes = make_trace(kind, n, 3 * samples / 10_000).reshape(3, -1).round(3)
                folder = root / "AccelScansComponents" / "Movement" / split
                folder.mkdir(parents=True, exist_ok=True)
                for axis, values in zip("XYZ", axes, strict=True):
                    np.savetxt(folder / f"{label}_Movement_{axis}_{mark}{n}.txt", values, "%.9g")
                for light in ("NoFlash", "Flash"):
                    photos = root / "ImageScans" / light / split
                    write_image(photos / f"{label}_Image_{n}_{mark}{n}.jpg", 10 * kind + n, *size)
            if mark == "train":
                sound = root / f"SoundScans/Movement/{split}/{label}_Sound_Movement_{mark}1.wav"
                tap = root / f"AccelScansComponents/Tapping/{split}/{label}_Tapping_{mark}1.txt"
                for path in (sound, tap):
                    path.parent.mkdir(parents=True, exist_ok=True)
                soundfile.write(sound, axes[0], 44_100)
                np.savetxt(tap, axes[0])
    return root


def write_kylberg(root: Path, *size: int) -> Path:
    for kind, label in enumerate(("blanket1", "canvas1")):
        for patch in range(160):
            name = f"{label}-{'abcd'[patch // 40]}-p{patch % 40 + 1:03d}.png"
            write_image(root / label / name, 1000 * kind + patch, *size)
    return root


def write_kth(root: Path, *size: int, scales: int = 9) -> Path:
    for kind, label in enumerate(("cork", "wool")):
        for seed in range(4 * scales * 12):
            sample, image = "abcd"[seed % 4], seed // 4
            name = f"22{sample}-scale_{image // 12 + 2}_im_{image % 12 + 1}_col.png"
            write_image(root / label / f"sample_{sample}" / name, 1000 * kind + seed, *size)
    return root


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("published")
    write_tum(root / "tum", 3, 0.1, 16)
    write_lmt108(root / "lmt108", 5, 8, 8)
    write_kylberg(root / "kylberg", 4, 4)
    write_kth(root / "kth_tips2b", 4, 4, scales=1)
    write_cluster(root / "cluster", 0.6)
    return root


@pytest.fixture
def copy(tiny, tmp_path) -> Path:
    return shutil.copytree(tiny, tmp_path / "data")


def given(root: Path, name: str, *keys: str) -> list[str]:
    return [f"data={name}", f"data.root={root / name}", *keys]


def test_tum_takes_photo_classes_from_their_order(tiny):
    rows = read(*given(tiny, "tum"))
    assert rows.classes == ["S1", "S2", "S3"]
    photos = [row for label in rows.classes for row in rows.of("image").in_classes([label])]
    assert [row.path.name for row in photos] == [f"IMG_{5529 + i}.JPG" for i in range(30)]
    assert [row.fold for row in photos] == list(range(10)) * 3
    strokes = rows.of("haptic").in_classes(["S2"])
    assert {row.group: row.fold for row in strokes} == {f"S2/{n}": n for n in range(10)}
    assert {row.group for row in photos} == {row.group for row in rows.of("haptic")}
    assert {row.sampling_rate for row in rows.of("haptic")} == {10_000}


def test_photos_of_tum_are_counted(copy):
    photos = copy / "tum" / "Training" / "Images"
    shutil.copytree(photos, photos.with_name("ImageMagnified"))
    assert len(read(*given(copy, "tum")).of("image")) == 30
    shutil.copytree(photos, photos.with_name("Other"))
    with pytest.raises(UserError, match="holds 60 photos, but 3 classes need 10 each"):
        read(*given(copy, "tum"))
    for folder in (photos, photos.with_name("Other")):
        shutil.rmtree(folder)
    assert len(read(*given(copy, "tum"))) == 30


TAPPING = "+data.reader.folders.tapping=AccelScansComponents/Tapping"


def test_lmt108_has_one_recording_for_three_axes_and_other_senses_beside_it(tiny):
    rows = read(*given(tiny, "lmt108", TAPPING))
    assert rows.classes == ["G1AluminiumMesh", "G2Brick"]
    counts = {"haptic": 20, "image": 20, "sound": 2, "tapping": 2}
    assert {sense: len(rows.of(sense)) for sense in counts} == counts
    assert {row.path.parent.name for row in rows} == {"Training"}
    assert {row.path.parts[-3] for row in rows.of("image")} == {"NoFlash"}
    assert all(row.path.stem.endswith(f"_train{row.fold + 1}") for row in rows)
    rates = {row.modality: row.sampling_rate for row in rows}
    assert rates == {"haptic": 10_000, "image": None, "sound": None, "tapping": 10_000}
    other = read(*given(tiny, "lmt108", "data.reader.split=testing"))
    assert {row.path.parent.name for row in other} == {"Testing"}
    assert len(other) == 40


def test_kylberg_groups_by_patch_or_by_surface(copy):
    rows = read(*given(copy, "kylberg"))
    assert rows.classes == ["blanket1", "canvas1"]
    assert len({row.group for row in rows}) == 2 * 160
    for fold in range(10):
        patches = [row.path.stem for row in rows if row.fold == fold]
        assert {patch.split("-")[1] for patch in patches} == set("abcd")
        assert {int(patch[-3:]) % 10 for patch in patches} == {(fold + 1) % 10}
    for row in read(*given(copy, "kylberg", "data.group_by=surface")):
        assert row.path.stem.split("-")[1] == "abcd"[row.fold]
    patch = sorted((copy / "kylberg").rglob("*.png"))[5]
    shutil.copy(patch, patch.with_name(f"{patch.stem}-r30.png"))
    assert sum(row.group == "blanket1/5" for row in read(*given(copy, "kylberg"))) == 2


def test_a_sample_of_kth_tips2b_is_a_group(tiny):
    rows = read(*given(tiny, "kth_tips2b"))
    assert (rows.classes, len(rows)) == (["cork", "wool"], 2 * 4 * 12)
    assert all(row.path.parent.name == f"sample_{'abcd'[row.fold]}" for row in rows)


FORCE = "+data.reader.folders.force=sensor_data/force"


def test_strokes_of_cluster_have_conditions_and_the_rate_of_their_stamps(tiny):
    rows = read(*given(tiny, "cluster", "data.folds=2", FORCE))
    assert rows.classes == sorted(SURFACES, key=int)
    for sense in ("haptic", "force"):
        assert len(rows.of(sense)) == len(SURFACES) * len(STROKES)
        for row in rows.of(sense):
            assert row.path.stem == "_".join((row.label, *dict(row.conditions).values()))
    first = rows.of("haptic").rows[0]
    assert [name for name, _ in first.conditions] == ["direction", "speed", "force", "repetition"]
    trace, source, _ = SignalDecoder(RATE).decode(first.path)
    assert source == pytest.approx(RATE, rel=2e-3)
    np.testing.assert_allclose(trace.std(axis=1), tone(0, RATE, 0.6, 0, 3).std(axis=1), rtol=0.02)


@pytest.mark.parametrize(
    ("group_by", "values"),
    [("direction", "0 135"), ("speed", "20 60"), ("force", "500 1000"), ("repetition", "0 1")],
)
def test_a_group_of_cluster_is_a_value(tiny, group_by, values):
    rows = read(*given(tiny, "cluster", f"data.group_by={group_by}"))
    groups = {(row.fold, dict(row.conditions)[group_by]) for row in rows.of("haptic")}
    assert groups == set(enumerate(values.split()))
    assert len({row.group for row in rows}) == 2  # of all classes


def test_folds_of_a_published_set_stay_where_a_class_lacks_recordings(copy):
    next((copy / "tum").rglob("S1_query3.txt")).unlink()
    rows = read(*given(copy, "tum")).of("haptic")
    assert all(row.path.stem.endswith(f"_query{row.fold}") for row in rows)
    halved = read(*given(copy, "tum", "data.folds=5")).of("haptic")
    assert all(int(row.path.stem[-1]) % 5 == row.fold for row in halved)


def rename(old: str, new: str):
    return lambda path: path.rename(path.with_name(path.name.replace(old, new)))


@pytest.mark.parametrize(
    ("name", "file", "change", "note"),
    [
        ("kylberg", "canvas1/canvas1-c-p011.png", rename("-c-", "-e-"), "e-p011.png"),
        ("kth_tips2b", "cork/sample_b/22b-scale_2_im_8_col.png", rename("b-", "e-"), "not read"),
        ("cluster", "sensor_data/accel/7/7_0_20_500_0.csv", rename("_500_0", ""), "Not called"),
    ],
)
def test_what_is_not_read_is_noted(copy, name, file, change, note):
    count = len(read(*given(copy, name)))
    change(copy / name / file)
    rows = read(*given(copy, name))
    assert count - len(rows) == 1
    assert sum(note in warning for warning in rows.notes) == 1


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (
            ["data=tum"],
            r"Folder \. holds no LABEL_query0\.txt; check data\.root, or get .* from https:.*tum",
        ),
        (["data=kylberg"], r"holds no CLASS/.*, or get the data set from https://www\.cb\.uu\.se"),
        (["data=kylberg", "data.group_by=surfaces"], r"did you mean surface\?"),
        (["data=cluster", "data.group_by=velocity"], "choose speed, direction, force, repetition"),
    ],
)
def test_empty_folders_and_unknown_choices_raise_errors(overrides, message, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UserError, match=message):
        read("data.root=.", *overrides)
