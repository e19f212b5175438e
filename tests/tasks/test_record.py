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

from tex_lightning.data.recordings import read_manifest
from tex_lightning.recording.recorder import Recorder

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
    return sorted(str(path.relative_to(root)) for path in root.rglob("*") if path.is_file())


def samples_of(tmp_path, name, label="oak"):
    samples, rate = soundfile.read(tmp_path / "DATA" / label / "haptic" / name, dtype="float32")
    assert rate == RATE
    return samples.T


def test_a_pipe_is_written_whole_and_labelled_on_the_way(
    record, cli, untrained, tmp_path, monkeypatch
):
    trace = make_trace(1, 0, seconds=3)
    reading, writing = os.pipe()
    writer = threading.Thread(
        target=lambda: [os.write(writing, trace.tobytes()), os.close(writing)]
    )
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(fileno=lambda: reading))
    checkpoint = untrained / "checkpoints" / "haptic.ckpt"
    writer.start()
    *said, last = lines(
        record(
            *OAK,
            "haptic=-",
            "record.seconds=3",
            f"checkpoint={checkpoint}",
            "top_k=1",
            "stream.window=null",
        )
    )
    writer.join()
    os.close(reading)
    np.testing.assert_array_equal(samples_of(tmp_path, "oak_001.wav"), trace)
    assert [line["time"] for line in said] == [round(0.1 * n, 6) for n in range(1, 31)]
    assert said[0]["label"] is None
    wav = tmp_path / "DATA" / "oak" / "haptic" / "oak_001.wav"
    assert last == {"recording": "oak_001", "seconds": 3.0, "files": [str(wav)], "warnings": []}
    (whole,) = lines(cli("task=predict", f"checkpoint={checkpoint}", f"haptic={wav}"))
    keys = ("label", "fragments")
    assert [said[-1][key] for key in keys] == [whole[key] for key in keys]
    assert said[-1]["probability"] == pytest.approx(whole["probability"], abs=1e-4)


def test_strokes_are_found_by_contact(record, tmp_path):
    rng = np.random.default_rng(0)

    def quiet(seconds):
        return 0.001 * rng.standard_normal(round(seconds * RATE)).astype(np.float32)

    strokes = [make_trace(0, number, seconds) for number, seconds in enumerate((2, 0.4, 1.5, 3))]
    signal = np.concatenate([*(x for stroke in strokes for x in (quiet(1), stroke)), quiet(1)])
    how = ("record.contact=true", "record.count=4", "record.seconds=2.5")
    outcome = record(*OAK, *how, haptic=signal)
    said = lines(outcome)
    assert written(tmp_path) == [
        "manifest.csv", *(f"oak/haptic/oak_00{number}.wav" for number in (1, 2, 3))
    ]  # fmt: skip
    whole = (strokes[0], strokes[2], strokes[3][: round(2.5 * RATE)])  # 0.4 s were a tap
    for number, stroke in enumerate(whole, start=1):
        np.testing.assert_array_equal(samples_of(tmp_path, f"oak_00{number}.wav"), stroke)
    assert "0.40 s are too short and not kept" in outcome.err
    assert "has ended after 3 of 4 recordings" in outcome.err
    assert [line["recording"] for line in said[:11]] == [None] * 10 + ["oak_001"]


def test_all_senses_at_once(record, tmp_path):
    trace = np.stack([make_trace(0, number, seconds=1) for number in range(3)])
    text = "".join(f"{x};{y};{z}\n" for x, y, z in trace.T.tolist())
    (tmp_path / "lines").write_text(text)
    soundfile.write(tmp_path / "s.flac", make_trace(1, 0, seconds=1), 22_050, subtype="PCM_16")
    Image.fromarray(make_photo(0, 0)).save(tmp_path / "photo.png")
    outcome = record(
        *OAK, f"haptic={tmp_path / 'lines'}", "record.haptic.format=text", "record.haptic.axes=3",
        f"sound={tmp_path / 's.flac'}", f"image={tmp_path / 'photo.png'}", "record.seconds=0.4",
        "record.least_seconds=0.3", "record.conditions={speed:60}",
    )  # fmt: skip
    *_, last = lines(outcome)
    assert last["warnings"] == []
    np.testing.assert_array_equal(samples_of(tmp_path, "oak_001.wav"), trace[:, :4000])
    table = read_manifest(tmp_path / "DATA" / "manifest.csv")
    found = {row.modality: (row.path.name, row.group, row.sampling_rate) for row in table}
    assert found == {
        "haptic": ("oak_001.wav", 0, RATE),
        "sound": ("oak_001.wav", 0, 22_050),
        "image": ("oak_001.jpg", 0, None),
    }
    assert {row.conditions for row in table} == {(("speed", "60"),)}
    info = soundfile.info(tmp_path / "DATA" / "oak" / "sound" / "oak_001.wav")
    assert (info.frames, info.samplerate, info.subtype) == (8820, 22_050, "FLOAT")


def test_what_is_wrong_with_a_recording_is_said_at_once(record):
    outcome = record(*OAK, "record.seconds=1", haptic=np.zeros(RATE))
    *_, last = lines(outcome)
    warning = "The trace is silent, so nothing was measured; check the sensor."
    assert last["warnings"] == [warning]
    assert f"Warning: oak_001: {warning}" in " ".join(outcome.err.split())


@pytest.mark.parametrize(("chunks", "kept"), [(15, True), (5, False)])
def test_ctrl_c_keeps_what_is_long_enough(record, tmp_path, monkeypatch, chunks, kept):
    follow, trace = Recorder.follow, make_trace(0, 0, seconds=3)

    def interrupted(self, *given):
        follow(self, *given)
        if self.signals[0].seconds >= chunks / 10:
            raise KeyboardInterrupt

    monkeypatch.setattr(Recorder, "follow", interrupted)
    outcome = record(*OAK, haptic=trace)
    assert outcome.status == 130
    assert written(tmp_path) == (["manifest.csv", "oak/haptic/oak_001.wav"] if kept else [])
    if kept:
        np.testing.assert_array_equal(samples_of(tmp_path, "oak_001.wav"), trace[: 1000 * chunks])
    else:
        assert "what was begun is not kept" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["haptic=null"], ["task=record has nothing to read: give haptic=FILE"]),
        (
            ["record.label=a/b", "haptic=[a,b]", "record.least_seconds=9"],
            [
                "record.label is 'a/b', which cannot be the name of a folder",
                "task=record takes one source",
                "record.least_seconds exceeds record.seconds: choose less",
            ],
        ),
        (
            ["record.label=null", "haptic=null", "image=a.png", "record.contact=true"],
            ["record.label is null, but task=record needs one", "record.contact needs a signal"],
        ),
        (["image=camera:93"], ["image=camera:93 cannot be opened"]),
        (["record.seconds=1", "record.least_seconds=0.9"], ["has ended after 0.50 s"]),
        (["checkpoint=RUN", "haptic=null", "sound=a"], ["looks at haptic, which is not recorded"]),
    ],
)
def test_mistakes_are_told_and_leave_nothing(record, tmp_path, untrained, arguments, said):
    given = [each.replace("RUN", f"{untrained}/checkpoints/haptic.ckpt") for each in arguments]
    outcome = record(*OAK, *given, haptic=make_trace(0, 0, seconds=0.5))
    assert outcome.status == 2
    assert all(sentence in outcome.err for sentence in said)
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "DATA").exists()
