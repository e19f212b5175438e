"""Readers of published data sets, on small files under their real names."""

import json
import shutil
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import make_trace
from haptic_sets import read
from PIL import Image

from tex_lightning.data.readers.textures import NUMBERS
from tex_lightning.errors import UserError


def write_image(path: Path, seed: int, *size: int) -> None:
    """Grey noise, so that no two files are alike; ``size`` is height and width."""
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.random.default_rng(seed).integers(0, 256, size, dtype=np.uint8)
    Image.fromarray(pixels).save(path, **({"compress_level": 1} if path.suffix == ".png" else {}))


def write_lmt108(root: Path, samples: int, *size: int) -> Path:
    rng = np.random.default_rng(0)
    for place, label in enumerate(("G1AluminiumMesh", "G2Brick")):
        for mark, split in (("train", "Training"), ("test", "Testing")):
            for n in range(1, 11):
                folder = root / "AccelScansComponents" / "Movement" / split
                folder.mkdir(parents=True, exist_ok=True)
                for axis in "XYZ":
                    values = rng.standard_normal(samples).round(3).tolist()
                    file = folder / f"{label}_Movement_{axis}_{mark}{n}.txt"
                    file.write_text("\n".join(map(str, values)))
                photos = root / "ImageScans" / "NoFlash" / split
                write_image(photos / f"{label}_Image_{n}_{mark}{n}.jpg", 10 * place + n, *size)
                flash = root / "ImageScans" / "Flash" / split
                write_image(flash / f"{label}_Image_{n}_{mark}{n}.jpg", 10 * place + n, 8, 8)
    return root


def write_more_of_lmt108(root: Path, samples: int) -> Path:
    """Sounds, and taps in one file each, of the training half."""
    for place, label in enumerate(("G1AluminiumMesh", "G2Brick")):
        for n in range(1, 11):
            sound = root / "SoundScans/Movement/Training" / f"{label}_Sound_Movement_train{n}.wav"
            tap = root / "AccelScansComponents/Tapping/Training" / f"{label}_Tapping_train{n}.txt"
            sound.parent.mkdir(parents=True, exist_ok=True)
            tap.parent.mkdir(parents=True, exist_ok=True)
            values = make_trace(place, n, samples / 10_000)
            soundfile.write(sound, values, 44_100)
            tap.write_text("\n".join(map(str, values.round(3).tolist())))
    return root


def write_kylberg(root: Path, *size: int, rotations: tuple[str, ...] = ("",)) -> Path:
    for place, label in enumerate(("blanket1", "canvas1")):
        for patch in range(160):
            for rotation in rotations:
                name = f"{label}-{'abcd'[patch // 40]}-p{patch % 40 + 1:03d}{rotation}.png"
                write_image(root / label / name, 1000 * place + patch, *size)
    return root


def write_kth(root: Path, *size: int) -> Path:
    seed = 0
    for label in ("cork", "wool"):
        for sample in "abcd":
            for scale in range(2, 11):
                for image in range(1, 13):
                    name = f"{NUMBERS[label]}{sample}-scale_{scale}_im_{image}_col.png"
                    write_image(root / label / f"sample_{sample}" / name, seed, *size)
                    seed += 1
    return root


@pytest.fixture(scope="module")
def tiny(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("published")
    write_lmt108(root / "lmt108", 5, 8, 8)
    write_kylberg(root / "kylberg", 4, 4)
    write_kth(root / "kth_tips2b", 4, 4)
    return root


@pytest.fixture
def copy(tiny, tmp_path) -> Path:
    return shutil.copytree(tiny, tmp_path / "data")


def test_lmt108_has_one_recording_for_three_axes_and_a_photo_beside_it(tiny):
    given = ["data=lmt108", f"data.root={tiny}/lmt108"]
    rows = read(*given)
    assert rows.classes == ["G1AluminiumMesh", "G2Brick"]
    assert len(rows.of("haptic")) == len(rows.of("image")) == 20
    assert {row.path.parent.name for row in rows} == {"Training"}
    assert {row.path.parts[-3] for row in rows.of("image")} == {"NoFlash"}
    for row in rows:
        assert row.path.stem.endswith(f"_train{row.group + 1}")
    assert {row.sampling_rate for row in rows.of("haptic")} == {10_000.0}
    other = read(*given, "data.reader.split=testing")
    assert {row.path.parent.name for row in other} == {"Testing"}
    assert len(other) == 40


def test_lmt108_names_what_is_missing_or_misspelt(copy):
    root = copy / "lmt108"
    given = ["data=lmt108", f"data.root={root}"]
    movement = root / "AccelScansComponents" / "Movement" / "Training"
    axis = movement / "G2Brick_Movement_Y_train4.txt"
    axis.rename(copy / "spare")
    with pytest.raises(UserError, match=f"File {axis} does not exist, but other axes"):
        read(*given)
    for one in "XZ":
        (movement / f"G2Brick_Movement_{one}_train4.txt").unlink()
    with pytest.raises(UserError, match=r"traces 1 to 10 of G2Brick, but lacks number \[4\]"):
        read(*given)
    shutil.rmtree(movement)
    with pytest.raises(UserError, match=r"holds no LABEL_Movement_X_train1\.txt files"):
        read(*given)
    testing = [*given, "data.reader.split=testing"]
    photos = root / "ImageScans" / "NoFlash" / "Testing"
    double = shutil.copy(photos / "G2Brick_Image_1_test1.jpg", photos / "G2Brick_Image_2_test1.jpg")
    with pytest.raises(UserError, match="have the same number; keep one of them"):
        read(*testing)
    double.unlink()
    for photo in photos.glob("G2Brick*"):
        photo.rename(photo.with_name(photo.name.replace("Brick", "Brik")))
    with pytest.raises(UserError, match=r"no photos of G2Brick; correct the name .* \(G2Brik\)"):
        read(*testing)
    shutil.rmtree(root / "ImageScans")
    assert len(read(*testing)) == 20


TAPPING = "+data.reader.folders.tapping=AccelScansComponents/Tapping"


def test_lmt108_has_sounds_and_further_senses_beside_the_traces(copy):
    root = write_more_of_lmt108(copy / "lmt108", 5)
    given = ["data=lmt108", f"data.root={root}"]
    rows = read(*given)
    assert len(rows.of("sound")) == 20
    assert {row.sampling_rate for row in rows.of("sound")} == {44_100.0}
    assert all(row.path.stem.endswith(f"_train{row.group + 1}") for row in rows)
    assert {row.modality for row in read(*given, "data.reader.folders.sound=null")} == {
        "haptic",
        "image",
    }
    taps = read(*given, TAPPING).of("tapping")
    assert len(taps) == 20
    assert {row.sampling_rate for row in taps} == {10_000.0}
    bricks = [row.path for row in taps.in_classes(["G2Brick"])]
    for tap, name in product(bricks, "XYZ"):
        shutil.copy(tap, tap.with_name(tap.name.replace("g_", f"g_{name}_")))
    with pytest.raises(UserError, match=r"_X_train1.txt and .*g_train1.txt have the same number"):
        read(*given, TAPPING)
    for tap in bricks:
        tap.unlink()
    assert len(read(*given, TAPPING).of("tapping")) == 20
    bricks[0].with_name("G2Brick_Tapping_Y_train3.txt").unlink()
    with pytest.raises(UserError, match=r"one axis of three, but .*Tapping_Y_train3.txt does not"):
        read(*given, TAPPING)
    with pytest.raises(UserError, match=r"holds no LABEL_Tapping_X_train1.txt files.*folders.tap"):
        read(*given, TAPPING.replace("Tapping", "Taping"))
    (root / "SoundScans/Movement/Training/G2Brick_Sound_Movement_train10.wav").unlink()
    with pytest.raises(UserError, match=r"sound recordings 1 to 10 of G2Brick, but lacks .*\[10\]"):
        read(*given)


def test_taps_of_lmt108_end_to_end(cli, tmp_path):
    root = write_lmt108(tmp_path / "data", 5, 8, 8)
    write_more_of_lmt108(root, 8000)
    (tmp_path / "sense").mkdir()
    own = "defaults: [signal, bands, _self_]\nmodality: tapping\n"
    (tmp_path / "sense" / "tapping.yaml").write_text(own)
    given = ["experiment=few/haptic", "model.senses=[tapping]", "data=lmt108", f"data.root={root}"]
    networks = run(cli, tmp_path / "run", "--config-dir", str(tmp_path), *given, TAPPING)
    assert networks["tapping"]["correct"] == networks["tapping"]["test_samples"] == 2


def test_kylberg_groups_by_patch_or_by_surface(tiny):
    given = ["data=kylberg", f"data.root={tiny}/kylberg"]
    rows = read(*given)
    assert rows.classes == ["blanket1", "canvas1"]
    assert sorted(row.group for row in rows) == sorted([*range(160)] * 2)
    fold = {row.path.stem.split("-")[1] for row in rows if row.group % 10 == 3}
    assert fold == set("abcd")
    surfaces = read(*given, "data.group_by=surface")
    for row in surfaces:
        assert row.path.stem.split("-")[1] == "abcd"[row.group]


def test_rotations_of_a_kylberg_patch_stay_together(tmp_path):
    write_kylberg(tmp_path, 2, 2, rotations=("-r0", "-r30"))
    rows = read("data=kylberg", f"data.root={tmp_path}")
    assert len(rows) == 640
    groups = {(row.label, row.path.stem.rpartition("-r")[0], row.group) for row in rows}
    assert len(groups) == 320
    (tmp_path / "canvas1" / "canvas1-b-p007-r30.png").unlink()
    with pytest.raises(UserError, match="1 rotations of patch b-p007, but 2 of others"):
        read("data=kylberg", f"data.root={tmp_path}")


def test_kylberg_counts_and_names_are_checked(copy):
    given = ["data=kylberg", f"data.root={copy}/kylberg"]
    patch = copy / "kylberg" / "canvas1" / "canvas1-c-p011.png"
    patch = patch.rename(patch.with_name("canvas1-e-p011.png"))
    with pytest.raises(UserError, match=f"File {patch} is not called canvas1-a-p001.png"):
        read(*given)
    patch.unlink()
    with pytest.raises(UserError, match="canvas1 holds 159 patches, but a class has 160"):
        read(*given)
    (copy / "empty").mkdir()
    with pytest.raises(UserError, match=r"holds no CLASS/CLASS-a-p001\.png"):
        read("data=kylberg", f"data.root={copy}/empty")
    with pytest.raises(UserError, match="does not exist"):
        read("data=kylberg", f"data.root={copy}/nothing")


def test_a_sample_of_kth_tips2b_is_a_group(tiny):
    rows = read("data=kth_tips2b", f"data.root={tiny}/kth_tips2b")
    assert rows.classes == ["cork", "wool"]
    assert len(rows) == 2 * 4 * 108
    assert all(row.path.parent.name == f"sample_{'abcd'[row.group]}" for row in rows)


def test_kth_tips2b_names_what_is_wrong(copy):
    root = copy / "kth_tips2b"
    given = ["data=kth_tips2b", f"data.root={root}"]
    photo = root / "cork" / "sample_b" / "16b-scale_6_im_8_col.png"
    photo.rename(photo.with_name("16b-scale_6_im_13_col.png"))
    with pytest.raises(UserError, match=r"sample_b holds 108 photos .* lacks 16b-scale_6_im_8_col"):
        read(*given)
    photo.with_name("16b-scale_6_im_13_col.png").rename(photo)
    shutil.copy(photo, photo.with_name("22b-scale_6_im_8_col.png"))
    with pytest.raises(UserError, match=r"109 photos .* has 22b-scale_6_im_8_col.png, which"):
        read(*given)
    (root / "cork").rename(root / "corc")
    with pytest.raises(UserError, match=r"corc is no class .* \(did you mean cork\?\)"):
        read(*given)
    with pytest.raises(UserError, match="does not exist"):
        read("data=kth_tips2b", f"data.root={root}/nothing")


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["data=folder", "data.group_by=surface"], "is not read by data=folder"),
        (["data=kylberg", "data.group_by=surfaces"], "did you mean surface?"),
        (["data=lmt108", "data.reader.split=both"], "choose training, testing"),
        (["data=tum", "data.reader.splt=testing"], "data.reader.splt is no argument"),
        (["data=folder", "data.resize=256"], "turn one off"),
        (["data=cluster", "data.folds=2"], "give data.val_fold=null"),
        (["task=evaluate", "checkpoint=a", "data.inverted=true", "data.test_fold=null"], "number"),
    ],
)
def test_keys_that_do_not_fit_are_refused(cli, tmp_path, overrides, message):
    outcome = cli("data.root=.", *overrides, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert message in outcome.err


def run(cli, directory: Path, *arguments: str) -> dict:
    outcome = cli(*arguments, "debug=tiny", "trainer.threads=1", f"hydra.run.dir={directory}")
    assert outcome.status == 0, outcome.err
    return json.loads((directory / "results.json").read_text())["networks"]


@pytest.mark.slow
def test_lmt108_end_to_end_with_predictions_from_one_axis_path(cli, tmp_path):
    root = write_lmt108(tmp_path / "data", 24_000, 240, 320)
    given = ["data=lmt108", f"data.root={root}"]
    networks = run(cli, tmp_path / "run", "model=fusion", *given)
    assert networks["fusion"]["test_samples"] == 2
    checkpoint = tmp_path / "run" / "checkpoints" / "haptic.ckpt"
    x = root / "AccelScansComponents" / "Movement" / "Testing" / "G2Brick_Movement_X_test3.txt"
    shares = []
    for axis in "XZ":
        path = x.with_name(x.name.replace("_X_", f"_{axis}_"))
        outcome = cli("task=predict", f"checkpoint={checkpoint}", f"haptic={path}")
        assert outcome.status == 0, outcome.err
        answer = json.loads(outcome.out)
        shares.append(
            {key: value for key, value in answer.items() if key not in ("haptic", "latency_ms")}
        )
    assert shares[0] == shares[1]
    other = ["task=evaluate", f"checkpoint={checkpoint}", "data.reader.split=testing"]
    everything = run(cli, tmp_path / "other", *other, *given, "data.test_fold=null")
    assert everything["haptic"]["test_samples"] == 20


@pytest.mark.slow
def test_kylberg_end_to_end(cli, tmp_path):
    root = write_kylberg(tmp_path / "data", 224, 224)
    given = ["model=visual", "data=kylberg", f"data.root={root}"]
    networks = run(cli, tmp_path / "run", *given)
    assert networks["visual"]["test_samples"] == 32


@pytest.mark.slow
def test_kth_tips2b_end_to_end_in_both_protocols(cli, tmp_path):
    root = write_kth(tmp_path / "data", 24, 24)
    given = ["model=visual", "model.visual.width=0.1", "data=kth_tips2b", f"data.root={root}"]
    modern = run(
        cli,
        tmp_path / "modern",
        *given,
        "data.resize=224",
        "data.val_fold=2",
        "data.inverted=false",
    )
    assert modern["visual"]["test_samples"] == 2 * 108
    paper = [*given, "data.resize=224", "task=crossval", "data.inverted=true", "crossval.only=[1]"]
    networks = run(cli, tmp_path / "paper", *paper)
    assert networks["visual"]["test_samples"] == 3 * 2 * 108
    csv = (tmp_path / "paper" / "folds" / "1" / "predictions" / "visual.csv").read_text()
    assert "sample_b" not in csv
    assert all(f"sample_{sample}" in csv for sample in "acd")
    checkpoint = f"checkpoint={tmp_path}/paper/folds/1/checkpoints/visual.ckpt"
    again = ["task=evaluate", "data=kth_tips2b", f"data.root={root}", checkpoint]
    refused = cli(
        *again, "data.test_fold=1", "data.inverted=false", f"hydra.run.dir={tmp_path}/again"
    )
    assert refused.status == 2
    assert (
        "data.test_fold=1 data.inverted=true data.val_fold=null as in its training" in refused.err
    )
