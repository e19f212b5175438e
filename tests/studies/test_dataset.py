"""What is said of the data before work begins."""

import itertools
from pathlib import Path
from types import SimpleNamespace

import pytest
import soundfile
from conftest import RATE, make_trace

from tex_lightning.config import Folding
from tex_lightning.data.folds import with_folds
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.studies.dataset import Dataset, of_no_sense

RARE = {"oak": 10, "pine": 10, "yew": 2}  # recordings


@pytest.fixture
def dataset():
    rows = [
        Recording(label, "haptic", Path(f"{label}{n}.wav"), f"{label}/{n}", None, (("wet", "no"),))
        for label, count in RARE.items()
        for n in range(count)
    ]
    table = with_folds(Recordings(tuple(rows)), 10)
    store = SimpleNamespace(decoders={"haptic": None})
    return Dataset(table.classes, table, Recordings(()), store)


def test_recordings_of_no_sense_are_told():
    rows = [Recording("a", name, Path(f"{name}.csv"), 0) for name in ("haptic", "sound", "day1")]
    assert of_no_sense(Recordings(tuple(rows)), ("haptic",)) == [
        "Not read, as no sense is called so: 1 of day1 (such as day1.csv)."
    ]
    assert of_no_sense(Recordings(tuple(rows[:2])), ("haptic",)) == []


def test_classes_in_folders_of_subjects_are_told_how_they_are_read(cli, tmp_path):
    for subject, label in itertools.product(("s1", "s2"), ("wood", "steel")):
        folder = tmp_path / subject / label
        folder.mkdir(parents=True)
        soundfile.write(folder / "1.wav", make_trace(0, 0), RATE)
    done = cli("model=haptic", "data=folder", f"data.root={tmp_path}")
    assert done.status == 2
    assert f"task=manifest data.root={tmp_path} pattern='{{group}}/{{label}}/*.wav'" in done.err


def test_photos_below_folders_of_sessions_are_told_beside_the_tables_that_lie_in_these(
    cli, tmp_path
):
    for session, label in itertools.product(("day1", "day2"), ("wood", "steel")):
        frames = tmp_path / label / session / "frames"
        frames.mkdir(parents=True)
        (frames / "1.png").touch()
        (frames.parent / "poses.csv").write_text("x\n1\n")
    done = cli("model=visual", "data=folder", f"data.root={tmp_path}")
    assert done.status == 2
    assert f"task=manifest data.root={tmp_path} pattern='{{label}}/{{group}}/**/*.*'" in done.err


def division(test: int | None, val: int | None = None, where: object = None) -> Folding:
    return Folding(10, test, val, False, None, where)


def test_folds_without_a_class_are_said_in_one_sentence(dataset):
    with_yew = sorted({row.fold for row in dataset.recordings if row.label == "yew"})
    without = [fold for fold in range(10) if fold not in with_yew]
    assert dataset.absences(map(division, with_yew)) == []
    (one,) = dataset.absences([division(without[0])])
    assert f"fold {without[0]} has none of yew. What is measured there" in one
    (every,) = dataset.absences(map(division, range(10)))
    assert f"fold {without[2]} has none of yew; 5 more parts lack some." in every
    (chosen,) = dataset.absences([division(with_yew[0], without[0])])
    assert f"fold {without[0]}, which chooses epoch and temperature, has none of yew" in chosen
    assert dataset.absences([division(None, None, {"wet": "no"})]) == []
