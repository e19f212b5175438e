"""Readers of published data sets, on small files under their real names."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import soundfile
from conftest import make_trace
from haptic_sets import read
from PIL import Image

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


def write_kylberg(root: Path, *size: int) -> Path:
    for place, label in enumerate(("blanket1", "canvas1")):
        for patch in range(160):
            name = f"{label}-{'abcd'[patch // 40]}-p{patch % 40 + 1:03d}.png"
            write_image(root / label / name, 1000 * place + patch, *size)
    return root


def write_kth(root: Path, *size: int) -> Path:
    seed = 0
    for label in ("cork", "wool"):
        for sample in "abcd":
            for scale in range(2, 11):
                for image in range(1, 13):
                    name = f"22{sample}-scale_{scale}_im_{image}_col.png"
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


def rename(old: str, new: str):
    return lambda path: path.rename(path.with_name(path.name.replace(old, new)))


@pytest.mark.parametrize(
    ("given", "file", "damage", "message"),
    [
        (
            "lmt108", "AccelScansComponents/Movement/Training/G2Brick_Movement_Y_train4.txt",
            Path.unlink, "Recording 4 of G2Brick .*X_train4.txt, .*Z_train4.txt; a recording is",
        ),
        ("lmt108", "AccelScansComponents", shutil.rmtree, r"holds no LABEL_Movement_X_train1\.txt"),
        (
            "lmt108", "ImageScans/NoFlash/Training/G2Brick_Image_1_train1.jpg",
            rename("train1", "train2"), "Recording 2 of G2Brick .* is G2Brick_Image_1_train2.jpg,",
        ),
        (
            "lmt108", "ImageScans/NoFlash",
            lambda path: [*map(rename("Bri", "Br"), path.rglob("*.jpg"))],
            "no photos of G2Brick; correct the names, or leave them out by data.reader.folders.im",
        ),
        ("kylberg", "canvas1/canvas1-c-p011.png", rename("-c-", "-e-"), "not called canvas1-a"),
        (
            "kth_tips2b", "cork/sample_b/22b-scale_6_im_8_col.png", rename("b-", "e-"),
            "is not called 22a-scale_2_im_1_col.png",
        ),
        ("kylberg", "", shutil.rmtree, r"holds no CLASS/canvas1-a-p001\.png; check data.root"),
    ],
)  # fmt: skip
def test_what_is_missing_or_misspelt_is_named(copy, given, file, damage, message):
    damage(copy / given / file)
    with pytest.raises(UserError, match=message):
        read(f"data={given}", f"data.root={copy}/{given}")


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
    turned = sorted((tiny / "kylberg").rglob("*.png"))[5]
    turned = shutil.copy(turned, turned.with_name(f"{turned.stem}-r30.png"))
    assert sum(row.group == 5 for row in read(*given)) == 3  # with the same patch
    turned.unlink()


def test_a_sample_of_kth_tips2b_is_a_group(tiny):
    rows = read("data=kth_tips2b", f"data.root={tiny}/kth_tips2b")
    assert rows.classes == ["cork", "wool"]
    assert len(rows) == 2 * 4 * 108
    assert all(row.path.parent.name == f"sample_{'abcd'[row.group]}" for row in rows)


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
