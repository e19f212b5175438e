"""Readers of today's haptic data sets, on small folders in their layouts."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile
from haptic_sets import RATE, STROKES, SURFACES, read, tone, write_cluster, write_hatt
from omegaconf import OmegaConf

from tex_lightning.config import CONF
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.readers.haptic import ClusterReader, HattReader
from tex_lightning.data.recordings import overlap
from tex_lightning.errors import UserError

FEW = [(0, 20, 500, 0), (0, 60, 500, 0)]
TWO_FOLDS = ["data.folds=2", "data.val_fold=null"]
FORCE = "+data.reader.folders.force=sensor_data/force"
TRACE = "sensor_data/accel/7/7_0_20_500_0.csv"


@pytest.fixture(scope="module")
def cluster(tmp_path_factory) -> Path:
    sensors = ("accel", "force", "images")
    return write_cluster(tmp_path_factory.mktemp("cluster"), 0.6, *sensors)


@pytest.fixture(scope="module")
def few(tmp_path_factory) -> Path:
    """Two strokes of each surface."""
    sensors = ("accel", "audio", "images")
    return write_cluster(tmp_path_factory.mktemp("few"), 0.6, *sensors, strokes=FEW)


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
    assert f"group_by={group_by}" in note.text
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


def rename(file: str, name: str) -> Callable[[Path], None]:
    return lambda root: (root / file).rename((root / file).with_name(name))


def change(file: str, old: str, new: str) -> Callable[[Path], None]:
    """Replace text in a file; ``old`` is a regular expression."""

    def act(root: Path) -> None:
        path = root / file
        text, count = re.subn(old, new, path.read_text(), count=1)
        assert count == 1
        path.write_text(text)

    return act


def duplicate(root: Path) -> None:
    shutil.copy(root / TRACE, (root / TRACE).with_name("7_0_020_500_0.csv"))


def backwards(file: str) -> Callable[[Path], None]:
    def act(root: Path) -> None:
        lines = (root / file).read_text().splitlines()
        lines[101], lines[102] = lines[102], lines[101]
        (root / file).write_text("\n".join(lines))

    return act


def sound(stroke: str, shape: tuple[int, ...], rate: int) -> Callable[[Path], None]:
    file = f"sensor_data/audio/{stroke.partition('_')[0]}/{stroke}.wav"
    return lambda root: soundfile.write(root / file, np.ones(shape), rate)


def in_place_of(file: str) -> Callable[[Path], None]:
    """A folder of the name of a file."""

    def act(root: Path) -> None:
        (root / file).unlink()
        (root / file).mkdir()

    return act


def without(folder: str) -> Callable[[Path], None]:
    return lambda root: shutil.rmtree(root / folder)


FOLDERS, SPEEDS = (
    OmegaConf.load(CONF / "data" / "cluster.yaml").reader[key] for key in ("folders", "groups")
)
STRETCHES = {"stretch": 3, "recording": 2}


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (without("sensor_data/accel"), r"accel does not exist; .*folders\.haptic=null"),
        (rename(TRACE, "7_0_20_500.csv"), "is not called ID_DIRECTION_SPEED_FORCE_REPETITION.csv"),
        (rename(TRACE, "7_0_25_500_0.csv"), "has the speed 25, but there are 20, 30, 40, 50, 60"),
        (rename(TRACE, "0_0_20_500_0.csv"), "of surface 0 lies in the folder 7; move it"),
        (duplicate, "7_0_020_500_0.csv and .*7_0_20_500_0.csv are one stroke; keep one of them"),
        (change(TRACE, "X,Y,Z", "X,Y"), "begins with 'time,X,Y' where the columns time,X,Y,Z are"),
        (in_place_of(TRACE), r"7_0_20_500_0.csv is a folder, a device, a pipe"),
        (rename("images/images_scan_area/img7.jpg", "7.jpg"), "is not called imgID.jpg, such as"),
        (rename("images/images_scan_area/img7.jpg", ".7"), "has no photos of 7; correct the name"),
        (rename("images/images_scan_area", "crop_images"), "overlap, so that folds would share"),
    ],
)
def test_a_defect_of_cluster_is_named(few, tmp_path, damage, message):
    root = shutil.copytree(few, tmp_path / "data")
    damage(root)
    with pytest.raises(UserError, match=message):
        ClusterReader(str(root), "speed", SPEEDS, FOLDERS).read()


def test_folders_that_hold_nothing_are_named(tmp_path):
    with pytest.raises(UserError, match=r"holds none of haptic, sound, image; check data.root"):
        ClusterReader(str(tmp_path), "speed", SPEEDS, {**FOLDERS, "haptic": None}).read()
    (tmp_path / "sensor_data" / "accel").mkdir(parents=True)
    with pytest.raises(UserError, match="accel holds no ID/ID_DIRECTION_SPEED_FORCE_REPETITION"):
        ClusterReader(str(tmp_path), "speed", SPEEDS, FOLDERS).read()


@pytest.mark.parametrize(
    ("model", "damages", "messages"),
    [
        (["experiment=few/haptic"], [rename(TRACE, "7_0_20_500.csv")], ["is not called ID_DIREC"]),
        (
            ["experiment=few/haptic"],
            [
                change(TRACE, r"(?m)^0\.05", "0.05x"),
                backwards("sensor_data/accel/7/7_0_60_500_0.csv"),
                change("sensor_data/accel/0/0_0_60_500_0.csv", r"(?s).+", ""),
            ],
            [
                "3 of 6 files cannot be used",
                r"7_0_20_500_0\.csv cannot be read \(could not convert string '0\.05x",
                r"7_0_60_500_0\.csv has times that do not rise at sample 101",
                r"0_0_60_500_0\.csv is empty",
            ],
        ),
        (
            ["model=sound", "debug=tiny"],
            [sound("7_0_20_500_0", (26_460, 2), 44_100), sound("0_0_20_500_0", (9000,), 22_050)],
            [
                "7_0_20_500_0.wav has two channels, but a trace has one or three axes",
                "22,050 Hz by its header, but 44,100 Hz are stated",
            ],
        ),
    ],
    ids=["name", "traces", "sounds"],
)
def test_a_run_ends_with_all_defects(cli, few, tmp_path, model, damages, messages):
    root = shutil.copytree(few, tmp_path / "data")
    for damage in damages:
        damage(root)
    given = [*model, "data=cluster", f"data.root={root}", *TWO_FOLDS, "trainer.threads=1"]
    outcome = cli(*given, f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 2
    for message in messages:
        assert re.search(message, outcome.err), outcome.err
    assert "Traceback" not in outcome.err


def test_defects_of_hatt_are_named(cli, hatt, tmp_path):
    root = shutil.copytree(hatt, tmp_path / "data")
    names = [path.name for path in sorted((root / "RecordedData").iterdir())]
    damages = {
        "its SampleRate is 0, which is no positive number": ("<SampleRate>10000", "<SampleRate>0"),
        "it has no SampleRate where one number": ("<SampleRate>10000</SampleRate>", ""),
        "it has no samples of AccelY": ("(?s)<AccelY.*AccelY>", ""),
        "it is no whole XML file: no element found": ("(?s)<ForceX.*", ""),
    }
    for name, damage in zip(names, damages.values(), strict=False):
        change(f"RecordedData/{name}", *damage)(root)
    given = ["experiment=few/haptic", "data=hatt", f"data.root={root}", *TWO_FOLDS]
    by = "data.group_by=recording"
    outcome = cli(*given, by, "trainer.threads=1", f"hydra.run.dir={tmp_path}/run")
    assert outcome.status == 2
    assert "4 of 6 files cannot be used" in outcome.err
    for name, message in zip(names, damages, strict=False):
        assert f"{name} cannot be read ({message}" in outcome.err
    last = root / "RecordedData" / names[-1]
    last.rename(last.with_name("Carpet 2_Trial01.xml"))
    with pytest.raises(UserError, match="are both recording 1 of Carpet 2; keep one"):
        HattReader(str(root), "stretch", STRETCHES, 3).read()
    shutil.rmtree(root / "RecordedData")
    with pytest.raises(UserError, match=r"holds no TEXTURE/RECORDING\.xml and no TEXTURE_Rec"):
        HattReader(str(root), "stretch", STRETCHES, 3).read()
    with pytest.raises(UserError, match="nowhere does not exist"):
        HattReader("nowhere", "stretch", STRETCHES, 3).read()


def test_groupings_that_there_are_not_are_refused():
    with pytest.raises(UserError, match="choose speed, direction, force, repetition"):
        ClusterReader("", "velocity", SPEEDS, FOLDERS)
    with pytest.raises(UserError, match="choose stretch, recording"):
        HattReader("", "texture", STRETCHES, 2)
