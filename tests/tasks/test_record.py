"""Recording through the command line."""

import json
import os
import sys
import threading
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image

from tex_lightning.core.run_folder import LOCK
from tex_lightning.data.manifest import read_manifest
from tex_lightning.recording.recorder import Signal

OAK = ("record.label=oak", f"record.haptic.rate={RATE}")


@pytest.fixture
def record(cli, tmp_path):
    """Run ``task=record`` into DATA; what the sensor sends lies in a file."""

    def run(*arguments, haptic=None):
        given = [] if haptic is None else [f"haptic={raw(tmp_path / 'sensor', haptic)}"]
        folders = [f"record.out={tmp_path / 'DATA'}", f"hydra.run.dir={tmp_path / 'run'}"]
        return cli("task=record", *folders, *given, *arguments)

    return run


def raw(path, samples):
    path.write_bytes(np.atleast_2d(samples).T.astype("<f4").tobytes())
    return path


def lines(outcome):
    assert outcome.status == 0, outcome.err
    return [json.loads(line) for line in outcome.out.splitlines()]


def written(tmp_path):
    root = tmp_path / "DATA"
    found = (path for path in root.rglob("*") if path.is_file() and path.name != LOCK)
    return sorted(str(path.relative_to(root)) for path in found)


def samples_of(tmp_path, name, label="oak"):
    samples, rate = soundfile.read(tmp_path / "DATA" / label / "haptic" / name, dtype="float32")
    assert rate == RATE
    return samples.T


def test_a_pipe_is_written_whole(record, tmp_path, monkeypatch):
    trace = make_trace(1, 0, seconds=3)
    reading, writing = os.pipe()

    def write() -> None:
        with os.fdopen(writing, "wb") as pipe:  # all of it, also where a signal interrupts
            pipe.write(trace.tobytes())

    writer = threading.Thread(target=write, daemon=True)
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(fileno=lambda: reading))
    writer.start()
    outcome = record(*OAK, "haptic=-", "record.seconds=1.25", "record.count=3")
    os.close(reading)
    writer.join(1)
    root = tmp_path / "DATA" / "oak" / "haptic"
    assert lines(outcome) == [
        {"recording": wav.stem, "seconds": 1.25, "files": [str(wav)], "warnings": []}
        for wav in (root / "oak_001.wav", root / "oak_002.wav")
    ]
    for number in (0, 1):
        part = trace[12_500 * number : 12_500 * (number + 1)]
        np.testing.assert_array_equal(samples_of(tmp_path, f"oak_00{number + 1}.wav"), part)
    assert "has ended after 2 of 3 recordings" in outcome.err


def test_all_senses_at_once(record, tmp_path):
    trace = np.stack([make_trace(0, number, seconds=1) for number in range(3)])
    text = "".join(f"{x};{y};{z}\n" for x, y, z in trace.T.tolist())
    (tmp_path / "lines").write_text(text)
    soundfile.write(tmp_path / "s.flac", make_trace(1, 0, seconds=1), 22_050, subtype="PCM_16")
    Image.fromarray(make_photo(0, 0)).save(tmp_path / "photo.png")
    outcome = record(
        *OAK, f"haptic={tmp_path / 'lines'}", "record.haptic.format=text", "record.haptic.axes=3",
        f"sound={tmp_path / 's.flac'}", f"image={tmp_path / 'photo.png'}", "record.seconds=0.4",
        "record.conditions={speed:60}",
    )  # fmt: skip
    lines(outcome)
    np.testing.assert_array_equal(samples_of(tmp_path, "oak_001.wav"), trace[:, :4000])
    table = read_manifest(tmp_path / "DATA" / "manifest.csv")
    found = {row.modality: (row.path.name, row.group, row.sampling_rate) for row in table}
    assert found == {
        "haptic": ("oak_001.wav", "oak/0", RATE),
        "sound": ("oak_001.wav", "oak/0", 22_050),
        "image": ("oak_001.jpg", "oak/0", None),
    }
    assert {row.conditions for row in table} == {(("speed", "60"),)}
    info = soundfile.info(tmp_path / "DATA" / "oak" / "sound" / "oak_001.wav")
    assert (info.frames, info.samplerate, info.subtype) == (8820, 22_050, "FLOAT")


def test_ctrl_c_keeps_the_recordings_that_are_whole(record, tmp_path, monkeypatch):
    fill, counts = Signal.fill, iter(range(15))

    def interrupted(self, seconds):
        if next(counts, None) is None:
            raise KeyboardInterrupt
        return fill(self, seconds)

    monkeypatch.setattr(Signal, "fill", interrupted)
    trace = make_trace(0, 0, seconds=3)
    outcome = record(*OAK, "record.seconds=1", "record.count=3", haptic=trace)
    assert outcome.status == 130
    assert written(tmp_path) == ["manifest.csv", "oak/haptic/oak_001.wav"]


def test_labels_and_conditions_are_as_they_were_typed_in_a_sweep_too(record, tmp_path):
    given = [f"record.haptic.rate={RATE}", "record.seconds=0.4"]
    given += ["record.conditions={day: 2024_05_01, lid: true, mass: 1.50, note: null}"]
    trace = make_trace(0, 0, seconds=0.5)
    lines(record(*given, "record.label=1_0", haptic=trace))
    swept = record(
        "-m", *given, "record.label=1e3,Grün", f"hydra.sweep.dir={tmp_path}/s", haptic=trace
    )
    assert swept.status == 0, swept.err
    table = read_manifest(tmp_path / "DATA" / "manifest.csv")
    assert table.classes == ["1_0", "1e3", "Grün"]
    assert {row.conditions for row in table} == {
        (("day", "2024_05_01"), ("lid", "true"), ("mass", "1.50"))
    }
    assert [row.path.parent.parent.name for row in table] == ["1_0", "1e3", "Grün"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["haptic=null"], ["task=record has nothing to read: give haptic=FILE"]),
        (
            ["record.label=a/b", "haptic=[a,b]"],
            [
                "record.label is 'a/b', which cannot be the name of a folder",
                "task=record takes one source",
            ],
        ),
        (
            ["record.seconds=0.9"],
            ["has ended before a recording was as long as record.seconds=0.9; send more"],
        ),
    ],
)
def test_mistakes_are_told_and_leave_nothing(record, tmp_path, arguments, said):
    outcome = record(*OAK, *arguments, haptic=make_trace(0, 0, seconds=0.5))
    assert outcome.status == 2
    assert all(sentence in outcome.err for sentence in said)
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "DATA").exists()
