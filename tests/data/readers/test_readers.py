"""Readers on small data in the real layouts."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from tex_lightning.config import CONF, DataConfig, register
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import read_manifest, write_manifest
from tex_lightning.errors import UserError
from tex_lightning.synthetic import SyntheticSpec, write_tum

SMALL = SyntheticSpec(classes=3, recordings=10, seconds=1.0, photo_width=64, photo_height=48)


def config(*overrides: str) -> DataConfig:
    register()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return OmegaConf.to_object(compose("config", overrides=list(overrides))).data


@pytest.fixture(scope="module")
def pristine(tmp_path_factory) -> Path:
    root = tmp_path_factory.mktemp("tum")
    write_tum(SMALL, root)
    return root


@pytest.fixture
def tum(pristine, tmp_path) -> Path:
    return shutil.copytree(pristine, tmp_path / "tum")


def test_folder_finds_files_by_type_and_passes_others_over(surfaces, tmp_path):
    root = shutil.copytree(surfaces, tmp_path / "data")
    (root / "alpha" / "image" / "Thumbs.db").write_text("x")
    (root / "alpha" / "haptic" / ".hidden.wav").write_text("x")
    (root / "empty").mkdir()
    (root / "notes.txt").write_text("x")
    rows = read_recordings(config("data=folder", f"data.root={root}"))
    assert rows.classes == ["alpha", "beta", "gamma"]
    assert len(rows.of("haptic")) == len(rows.of("image")) == 30
    assert {row.group for row in rows} == set(range(10))
    (note,) = rows.notes
    assert note.text.startswith(f"Class folder {root}/empty is skipped: there is no trace")


def test_the_number_of_classes_can_be_cut_but_not_stretched(surfaces):
    common = ["data=folder", f"data.root={surfaces}"]
    assert read_recordings(config(*common, "data.classes=2")).classes == ["alpha", "beta"]
    with pytest.raises(UserError, match="asks for 4 classes, but the data has 3"):
        read_recordings(config(*common, "data.classes=4"))


def test_a_folder_without_recordings_or_with_one_class(surfaces, tmp_path):
    with pytest.raises(UserError, match="holds no recordings; put traces in"):
        read_recordings(config("data=folder", f"data.root={tmp_path}"))
    shutil.copytree(surfaces / "alpha", tmp_path / "one" / "alpha")
    with pytest.raises(UserError, match="only the class alpha"):
        read_recordings(config("data=folder", f"data.root={tmp_path}/one"))


def test_a_manifest_gives_the_same_table_as_the_folder(surfaces, tmp_path):
    rows = read_recordings(config("data=folder", f"data.root={surfaces}"))
    write_manifest(rows, tmp_path / "m.csv")
    again = read_recordings(config("data=manifest", f"data.manifest={tmp_path}/m.csv"))
    assert set(again.rows) == {replace(row, path=row.path.resolve()) for row in rows}


def small(cache: Path, *overrides: str) -> DataConfig:
    return config(
        "data.classes=2",
        "data.synthetic.recordings=2",
        "data.synthetic.seconds=1",
        "data.synthetic.photo_width=64",
        "data.synthetic.photo_height=48",
        f"data.cache_dir={cache}",
        *overrides,
    )


def test_synthetic_is_rendered_once_and_survives_in_the_cache(cache, monkeypatch):
    first = read_recordings(small(cache))
    assert len(first) == 8
    monkeypatch.setattr("tex_lightning.data.readers.synthetic.write_folder", None)
    assert read_recordings(small(cache)) == first


def test_sounds_are_rendered_for_models_that_listen_and_beside_the_rest(tmp_path):
    silent = read_recordings(small(tmp_path, "model=fusion"))
    assert {row.modality for row in silent} == {"haptic", "image"}
    (before,) = (tmp_path / "synthetic").iterdir()
    every = read_recordings(small(tmp_path, "model.senses=[haptic,visual,sound]"))
    assert every.without(every.of("sound")) == silent
    assert before in (tmp_path / "synthetic").iterdir()
    assert len(list((tmp_path / "synthetic").iterdir())) == 2
    pairs = [{(row.label, row.group) for row in every.of(sense)} for sense in ("haptic", "sound")]
    assert pairs[0] == pairs[1]
    assert len(every.of("sound")) == 4


def test_a_checkpoint_gets_its_own_modalities_whatever_the_model(tmp_path):
    assert {row.modality for row in read_recordings(small(tmp_path), ["sound"])} == {"sound"}


def test_tum_takes_photo_classes_from_their_order(tum):
    rows = read_recordings(config("data=tum", f"data.root={tum}"))
    assert len(rows.classes) == 3
    photos = [row for label in rows.classes for row in rows.of("image").in_classes([label])]
    assert [row.path.name for row in photos] == [f"IMG_{5529 + i}.JPG" for i in range(30)]
    assert [row.group for row in photos] == list(range(10)) * 3
    trace = rows.of("haptic").rows[0]
    assert trace.sampling_rate == 10_000
    assert SignalDecoder().decode(trace.path, 10_000.0)[0].shape == (1, 10_000)


def test_tum_passes_magnified_photos_over_and_works_without_photos(tum):
    photos = tum / "Training" / "Images"
    shutil.copytree(photos, tum / "Training" / "ImageMagnified")
    assert len(read_recordings(config("data=tum", f"data.root={tum}")).of("image")) == 30
    shutil.copytree(photos, tum / "Training" / "Other")
    with pytest.raises(UserError, match="30 in Images and 30 in Other, but 3 classes need 30"):
        read_recordings(config("data=tum", f"data.root={tum}"))
    shutil.rmtree(photos)
    shutil.rmtree(tum / "Training" / "Other")
    assert len(read_recordings(config("data=tum", f"data.root={tum}"))) == 30


def test_tum_counts_are_checked_and_a_manifest_overrides_the_order(tum):
    rows = read_recordings(config("data=tum", f"data.root={tum}"))
    write_manifest(rows, tum / "m.csv")
    next((tum / "Training" / "Images").glob("*.JPG")).rename(tum / "spare.JPG")
    with pytest.raises(UserError, match="29 in Images, but 3 classes need 30"):
        read_recordings(config("data=tum", f"data.root={tum}"))
    lines = (tum / "m.csv").read_text().splitlines()
    few = [
        lines[0],
        *(line for line in lines if ",image," in line and (tum / line.split(",")[2]).is_file()),
    ]
    (tum / "m.csv").write_text("\n".join(few))
    given = config("data=tum", f"data.root={tum}", f"data.manifest={tum}/m.csv")
    assert len(read_recordings(given).of("image")) == 29


@pytest.mark.slow
def test_generated_surfaces_in_the_tum_layout_train_end_to_end(cli, tmp_path):
    size = [
        "data.classes=2",
        "data.synthetic.seconds=3",
        "data.synthetic.photo_width=480",
        "data.synthetic.photo_height=480",
    ]
    out = f"generate.out={tmp_path}/tum"
    deaf = cli("task=generate", *size, out, "generate.layout=tum", "generate.sound=true")
    assert deaf.status == 2
    assert "needs generate.layout=folder" in deaf.err
    written = cli("task=generate", *size, out, "generate.layout=tum", f"hydra.run.dir={tmp_path}/g")
    assert written.status == 0, written.err
    again = cli("task=generate", *size, out, f"hydra.run.dir={tmp_path}/h")
    assert again.status == 2
    assert "is not empty; name a new folder" in again.err
    run = cli(
        "model=fusion",
        "data=tum",
        f"data.root={tmp_path}/tum",
        "debug=tiny",
        f"hydra.run.dir={tmp_path}/run",
    )
    assert run.status == 0, run.err
    trace = np.loadtxt(next((tmp_path / "tum/Training/Accel").glob("*.txt")))
    assert trace.shape == (30_000,)


def test_generated_sounds_are_listed_in_the_manifest(cli, tmp_path):
    written = cli(
        "task=generate",
        "data.classes=2",
        "data.synthetic={recordings: 2, seconds: 1, photo_width: 64, photo_height: 48}",
        f"generate.out={tmp_path}/out",
        "generate.sound=true",
        f"hydra.run.dir={tmp_path}/run",
    )
    assert written.status == 0, written.err
    rows = read_manifest(tmp_path / "out" / "manifest.csv")
    assert [len(rows.of(each)) for each in ("haptic", "image", "sound")] == [4, 4, 4]


def test_synthetic_recordings_say_under_which_conditions_they_were_drawn(tmp_path):
    rows = read_recordings(small(tmp_path, "model.senses=[haptic,visual,sound]"))
    names = {row.modality: [name for name, _ in row.conditions] for row in rows}
    assert names["haptic"] == names["sound"] == ["speed", "force"]
    assert names["image"] == ["light", "distance"]
    strokes = [
        {(row.label, row.group): row.conditions for row in rows.of(sense)}
        for sense in ("haptic", "sound")
    ]
    assert strokes[0] == strokes[1]
