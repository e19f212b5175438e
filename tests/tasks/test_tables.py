"""Training and prediction on tables: what was read is said, columns are found by their names."""

import json

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_trace

READS = (
    "axes az, ax; 10,000 Hz by times in 'time (ms)'; left out: 'packet' (counter), 'class' (text)"
)


def write(path, label, kind, recording, order=("ax", "ay", "az")):
    """A table of three axes of which the second tells nothing."""
    axes = {"ax": make_trace(kind, recording, 3.0), "az": make_trace(kind, recording + 50, 3.0)}
    axes["ay"] = np.random.default_rng(recording).standard_normal(len(axes["ax"]))
    rows = zip(*(axes[name].round(6) for name in order), strict=True)
    lines = [
        f"{number},{number * 1000 / RATE},{','.join(map(str, row))},{label}"
        for number, row in enumerate(rows)
    ]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([f"packet,time (ms),{','.join(order)},class", *lines, ""]))


def test_columns_are_found_by_their_names_and_what_was_read_is_said_once(cli, tmp_path):
    for kind, label in enumerate(("oak", "tin")):
        for recording in range(4):
            path = tmp_path / "data" / label / "haptic" / f"{recording}.csv"
            write(path, label, kind, recording)
    with path.open("a") as file:
        file.write("7,")
    data = ["data=folder", f"data.root={tmp_path}/data", f"data.cache_dir={tmp_path}/cache"]
    run = ["model=mfcc_nb", "data.channels=[az,ax]", "debug=tiny", f"hydra.run.dir={tmp_path}/run"]
    trained = cli(*data, *run)
    assert trained.status == 0, trained.err
    said = " ".join(trained.err.split())
    assert said.count(READS) == 1
    assert said.count(f"{path}: the last line is no whole row and is left out: '7,'.") == 1
    given = ["task=predict", f"checkpoint={tmp_path}/run"]
    predicts_the_same_in_any_order(cli, given, tmp_path / "new")


def predicts_the_same_in_any_order(cli, given, folder):
    for place, order in enumerate((("ax", "ay", "az"), ("az", "ax", "ay"), ("ay", "az", "ax"))):
        write(folder / f"{place}.csv", "oak", 0, 9, order)
    outcome = cli(*given, f"haptic={folder}")
    lines = [json.loads(line) for line in outcome.out.splitlines()]
    changing = ("haptic", "latency_ms")
    found = [{k: v for k, v in line.items() if k not in changing} for line in lines]
    assert len(found) == 3
    assert found[0] == found[1] == found[2]
    assert " ".join(outcome.err.split()).count(READS) == 1
    other = cli(*given, f"haptic={folder}/0.csv", "data.channels=[ay]")
    assert "axes ay; 10,000 Hz" in other.err
    assert json.loads(other.out)["probability"] != lines[0]["probability"]
    missing = cli(*given, f"haptic={folder}/0.csv", "data.channels=[aw]")
    assert missing.status == 2
    assert "has no column 'aw' as data.channels asks for, but packet, time" in missing.err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "10,000 Hz by an assumption (data.file_rate=HZ gives it)"),
        (["data.file_rate=8000"], "8,000 Hz by data.file_rate"),
    ],
)
def test_a_prediction_says_where_the_rate_is_from(cli, untrained, tmp_path, given, said):
    np.savetxt(tmp_path / "a.txt", make_trace(0, 0), "%.6g")
    outcome = cli("task=predict", f"checkpoint={untrained}", f"haptic={tmp_path}/a.txt", *given)
    assert outcome.status == 0, outcome.err
    assert f"Reads traces: {said}." in " ".join(outcome.err.split())
    soundfile.write(tmp_path / "a.wav", make_trace(0, 0), RATE)
    outcome = cli("task=predict", f"checkpoint={untrained}", f"haptic={tmp_path}/a.wav", *given)
    assert "Reads traces: 10,000 Hz by the header of the file." in " ".join(outcome.err.split())


def test_a_unit_is_asked_for_and_given(cli, untrained, tmp_path):
    path = tmp_path / "a.csv"
    trace = make_trace(0, 0)
    lines = (f"{number / 10:.1f},{value}" for number, value in enumerate(trace))
    path.write_text("\n".join(["time,x", *lines]))
    asked = cli("task=predict", f"checkpoint={untrained}", f"haptic={path}")
    assert asked.status == 2
    assert "rises by 0.1 a sample, has no unit; give data.time_unit=ms" in asked.err
    given = cli("task=predict", f"checkpoint={untrained}", f"haptic={path}", "data.time_unit=ms")
    assert given.status == 0, given.err
    assert "10,000 Hz by times in 'time'" in given.err
    wrong = cli("task=predict", f"checkpoint={untrained}", f"haptic={path}", "data.time_unit=mss")
    assert "data.time_unit is 'mss' (did you mean ms?)" in wrong.err
