"""Readers of today's haptic data sets, on small folders in their layouts."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from haptic_sets import RATE, STROKES, SURFACES, read, tone, write_cluster, write_hatt
from omegaconf import OmegaConf

from tex_lightning.config import CONF
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.readers.haptic import ClusterReader, HattReader
from tex_lightning.data.recordings import overlap
from tex_lightning.errors import UserError

TWO_FOLDS = ["data.folds=2", "data.val_fold=null"]
FORCE = "+data.reader.folders.force=sensor_data/force"


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Path:
    sensors = ("accel", "force", "images")
    return write_cluster(tmp_path_factory.mktemp("cluster"), 0.6, *sensors)


@pytest.fixture(scope="module")
def hatt(tmp_path_factory) -> Path:
    return write_hatt(tmp_path_factory.mktemp("hatt"), 1.8)


def test_strokes_of_cluster_have_conditions_and_the_rate_of_their_stamps(cluster):
    rows = read("data=cluster", f"data.root={cluster}", "data.folds=2", FORCE)
    assert rows.classes == sorted(SURFACES, key=int)
    for sense in ("haptic", "force"):
        assert len(rows.of(sense)) == len(SURFACES) * len(STROKES)
        for row in rows.of(sense):
            stroke = [value for _, value in row.conditions]
            assert row.path.stem == "_".join((row.label, *stroke))
    first = rows.of("haptic").rows[0]
    assert [name for name, _ in first.conditions] == ["direction", "speed", "force", "repetition"]
    trace, source = SignalDecoder(RATE).decode(first.path)
    assert source.source == "time column"
    assert source.interpolated
    assert source.hz == pytest.approx(RATE, rel=2e-3)
    expected = tone(0, RATE, 0.6, 0, 3)
    assert trace.shape[0] == 3
    np.testing.assert_allclose(trace.std(axis=1), expected.std(axis=1), rtol=0.02)


@pytest.mark.parametrize(
    ("group_by", "values"),
    [("direction", "0 135"), ("speed", "20 60"), ("force", "500 1000"), ("repetition", "0 1")],
)
def test_a_group_is_a_value_and_has_a_strip_of_the_photo(cluster, group_by, values):
    given = ["data=cluster", f"data.root={cluster}", f"data.group_by={group_by}"]
    rows = read(*given, "data.folds=2")
    groups = {(row.group, dict(row.conditions)[group_by]) for row in rows.of("haptic")}
    assert groups == set(enumerate(values.split()))
    strips = rows.of("image").in_classes(["7"])
    assert [(row.group, row.part) for row in strips] == [(0, (0, 0.5)), (1, (0.5, 1))]
    (note,) = rows.notes
    assert "divided into 2 strips" in note.text
    assert {row.fold for row in read(*given, "data.folds=5")} == {0, 1}  # no more than groups


def test_photos_alone_have_as_many_strips_as_the_condition_has_values(cluster):
    off = ["data.reader.folders.haptic=null", "data.group_by=direction"]
    rows = read("data=cluster", f"data.root={cluster}", *off)
    strips = [row.part for row in rows.in_classes(["0"])]
    assert len(strips) == 8
    assert not any(overlap(a, b) for i, a in enumerate(strips) for b in strips[:i])


def test_recordings_of_hatt_are_read_in_both_layouts(hatt, tmp_path):
    given = ["data=hatt", "data.group_by=recording"]
    rows = read(*given, f"data.root={hatt}")
    assert rows.classes == ["ABS Plastic", "Carpet 1", "Carpet 2"]
    assert [(row.group, row.conditions) for row in rows.in_classes(["Carpet 2"])] == [
        (0, (("recording", "1"),)),
        (1, (("recording", "2"),)),
    ]
    assert rows.notes == ()
    trace, source = SignalDecoder().decode(rows.rows[0].path)
    np.testing.assert_allclose(trace, tone(0, 10_000, 1.8, 1, 3), rtol=1e-3, atol=1e-4)
    assert source.hz == 10_000
    folders = read(*given, f"data.root={write_hatt(tmp_path, 0.1, '{}/trial{}.xml')}")
    assert [(row.label, row.group) for row in folders] == [(row.label, row.group) for row in rows]


def test_stretches_of_hatt_are_disjoint_and_said_to_be_neighbours(hatt):
    rows = read("data=hatt", f"data.root={hatt}")
    assert len(rows) == 3 * 2 * 3
    for path in {row.path for row in rows}:
        parts = {row.group: row.part for row in rows if row.path == path}
        assert sorted(parts.values()) == [parts[0], parts[1], parts[2]]
        assert not any(overlap(parts[i], parts[i + 1]) for i in (0, 1))
    (note,) = rows.notes
    assert "divided into 3 stretches" in note.text


def results(directory: Path) -> dict:
    return json.loads((directory / "results.json").read_text())["networks"]["haptic"]


@pytest.mark.slow
def test_cluster_is_fitted_cross_validated_and_evaluated(cli, cluster, tmp_path):
    given = ["experiment=few/haptic", "data=cluster", f"data.root={cluster}", "trainer.threads=1"]
    crossval = cli(*given, "task=crossval", "data.folds=2", f"hydra.run.dir={tmp_path}/crossval")
    assert crossval.status == 0, crossval.err
    assert results(tmp_path / "crossval")["correct"] == len(SURFACES) * len(STROKES)
    table = (tmp_path / "crossval/folds/1/predictions/haptic.csv").read_text().splitlines()
    assert {re.search(r"_(\d+)_\d+_\d\.csv", line)[1] for line in table[1:]} == {"60"}
    by = ["data.group_by=repetition", *TWO_FOLDS]
    fit = cli(*given, *by, f"hydra.run.dir={tmp_path}/fit")
    assert fit.status == 0, fit.err
    assert "48 uneven, interpolated" in " ".join(fit.err.split() + fit.out.split())
    found = cli(
        *("task=evaluate", f"checkpoint={tmp_path}/fit", *given[1:], "data.folds=2"),
        *("data.group_by=repetition", f"hydra.run.dir={tmp_path}/evaluate"),
    )
    assert found.status == 0, found.err
    assert results(tmp_path / "evaluate")["correct"] == results(tmp_path / "fit")["correct"] == 24


def test_hatt_is_fitted_and_other_stretches_of_a_recording_are_no_leak(cli, hatt, tmp_path):
    given = ["data=hatt", f"data.root={hatt}", "trainer.threads=1"]
    fit = cli("model=mfcc_nb", *given, f"hydra.run.dir={tmp_path}/fit")
    assert fit.status == 0, fit.err
    assert "Each recording is divided into 3 stretches" in " ".join(fit.err.split())
    assert results(tmp_path / "fit")["correct"] == 6
    again = ["task=evaluate", f"checkpoint={tmp_path}/fit", *given]
    tested = cli(*again, f"hydra.run.dir={tmp_path}/tested")
    assert tested.status == 0, tested.err
    leak = cli(*again, "data.folds=2", f"hydra.run.dir={tmp_path}/leak")
    assert leak.status == 2
    assert "has trained on 6 of the 6 test recordings" in leak.err


def test_a_family_is_timed_on_parts_of_files(cli, hatt, tmp_path):
    outcome = cli(
        "task=frontier", "frontier=haptic", "frontier.only=[bands]", "frontier.rounds=3",
        "crossval.only=[0]", "data=hatt", f"data.root={hatt}", "trainer.threads=1",
        f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    (system,) = json.loads((tmp_path / "results.json").read_text())["systems"].values()
    assert system["latency_ms_mean"] > 0


FOLDERS, SPEEDS = (
    OmegaConf.load(CONF / "data" / "cluster.yaml").reader[key] for key in ("folders", "groups")
)
STRETCHES = {"stretch": 3, "recording": 2}


def test_what_is_missing_or_misspelt_is_named(cluster, tmp_path):
    empty = [ClusterReader(str(tmp_path), "speed", SPEEDS, FOLDERS)]
    empty.append(HattReader(str(tmp_path), "stretch", STRETCHES, 3))
    for reader, message in zip(
        empty, (r"accel holds no ID/ID_DIR", r"no TEXTURE/RECORD"), strict=True
    ):
        with pytest.raises(UserError, match=message):
            reader.read()
    root = shutil.copytree(cluster, tmp_path / "data")
    reader = ClusterReader(str(root), "speed", SPEEDS, FOLDERS)
    photo = root / "images/images_scan_area/img7.jpg"
    trace = root / "sensor_data/accel/7/7_0_20_500_0.csv"
    for path, name, message in (
        (photo, "7.jpg", "7.jpg is not called img0.jpg or the like"),
        (photo, ".7", "has no photos of 7; correct the names"),
        (trace, "7_0_20.csv", "7_0_20.csv is not called 0_135_40_500_0.csv or the like"),
    ):
        moved = path.rename(path.with_name(name))
        with pytest.raises(UserError, match=message):
            reader.read()
        moved.rename(path)
    with pytest.raises(UserError, match="choose speed, direction, force, repetition"):
        ClusterReader("", "velocity", SPEEDS, FOLDERS)


def test_a_run_ends_with_all_defects_of_files(cli, hatt, tmp_path):
    root = shutil.copytree(hatt, tmp_path / "data")
    damages = (
        ("<SampleRate>10000", "<SampleRate>0", "has a sampling rate of 0 Hz"),
        ("(?s)<AccelY.*AccelY>", "", "cannot be read .AccelX, AccelY, AccelZ have 18000, 0, 18000"),
        ("(?s)<ForceX.*", "", "cannot be read .no element found"),
    )
    files = sorted((root / "RecordedData").iterdir())
    for path, (old, new, _) in zip(files, damages, strict=False):
        path.write_text(re.sub(old, new, path.read_text()))
    given = ["experiment=few/haptic", "data=hatt", f"data.root={root}", *TWO_FOLDS]
    by = "data.group_by=recording"
    outcome = cli(*given, by, "trainer.threads=1", f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 2
    assert "3 of 6 files cannot be used" in outcome.err
    for path, (_, _, message) in zip(files, damages, strict=False):
        assert re.search(f"{path.name} {message}", outcome.err), outcome.err
