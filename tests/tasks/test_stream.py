"""Live classification through the command line."""

import io
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_trace
from scipy.signal import resample_poly

from tex_lightning.inference.stream import LiveStream

KEYS = ("label", "confidence", "fragments")


@pytest.fixture
def stream(fused, tmp_path):
    return [f"checkpoint={fused}/checkpoints/haptic.ckpt", f"hydra.run.dir={tmp_path / 'run'}"]


def lines(outcome) -> list[dict]:
    assert outcome.status == 0, outcome.err
    return [json.loads(line) for line in outcome.out.splitlines()]


def write(tmp_path, trace, rate=RATE) -> str:
    soundfile.write(tmp_path / "a.wav", trace, rate, subtype="FLOAT")
    return f"haptic={tmp_path / 'a.wav'}"


def pipe(monkeypatch, content: bytes) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(content)))


def test_a_replayed_file_ends_with_the_label_of_predict(cli, stream, tmp_path):
    file = write(tmp_path, make_trace(1, 42, seconds=3.05))
    said = lines(cli("task=stream", *stream, file, "stream.chunk=0.25"))
    (whole,) = lines(cli("task=predict", *stream, file))
    assert [line["time"] for line in said] == [*(0.25 * n for n in range(1, 13)), 3.05]
    assert (said[0]["label"], said[0]["fragments"]) == (None, 0)
    assert [said[-1][key] for key in KEYS] == [whole[key] for key in KEYS]


def test_samples_from_standard_input(cli, stream, tmp_path, monkeypatch):
    samples = np.stack([make_trace(0, n, seconds=2.5) for n in range(3)])
    np.save(tmp_path / "a.npy", samples)
    pipe(monkeypatch, samples.T.astype("<f4").tobytes())
    said = lines(cli("task=stream", *stream, "haptic=-", "stream.axes=3"))
    (whole,) = lines(cli("task=predict", *stream, f"haptic={tmp_path / 'a.npy'}"))
    assert len(said) == 25
    assert [said[-1][key] for key in KEYS] == [whole[key] for key in KEYS]


@pytest.mark.parametrize(
    ("content", "arguments", "said"),
    [
        ([], ["haptic=[a.wav,b.wav]"], "give one file"),
        ([], ["haptic=-", "sound=-"], "only one signal can be standard input"),
        ([0] * 500, ["haptic=-"], "experiment=few/haptic"),
        ([], [], "give haptic=FILE, or haptic=-"),
        ([np.nan] * 500, ["haptic=-"], "NaN, infinity or a number beyond 1e+09 at sample 0"),
    ],
)
def test_mistakes_are_told(cli, stream, monkeypatch, content, arguments, said):
    pipe(monkeypatch, np.array(content, "<f4").tobytes())
    outcome = cli("task=stream", *stream, *arguments)
    assert outcome.status == 2
    assert said in outcome.err
    assert "Traceback" not in outcome.err


def test_a_closed_standard_input_is_said(cli, stream, monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    outcome = cli("task=stream", *stream, "haptic=-")
    assert outcome.status == 2
    assert "Error: Standard input is closed" in outcome.err


def test_another_rate_is_resampled_on_the_way(cli, stream, tmp_path, monkeypatch):
    rate = 16_000
    samples = resample_poly(make_trace(1, 42, seconds=3.05), rate, RATE).astype("<f4")
    file = write(tmp_path, samples, rate)
    pipe(monkeypatch, samples.tobytes())
    from_file = lines(cli("task=stream", *stream, file))
    from_pipe = lines(cli("task=stream", *stream, "haptic=-", f"data.file_rate={rate}"))
    (whole,) = lines(cli("task=predict", *stream, file))
    for said in (from_file, from_pipe):
        assert [line["time"] for line in said[-3:]] == [2.9, 3.0, 3.05]
        assert [said[-1][key] for key in KEYS] == [whole[key] for key in KEYS]
        assert said[-1]["probability"] == pytest.approx(whole["probability"], abs=1e-6)


def test_ctrl_c_ends_it_as_elsewhere(cli, stream, surfaces, monkeypatch):
    push = LiveStream.push

    def interrupted(self, **chunks):
        if self.signals["haptic"].samples > RATE:
            raise KeyboardInterrupt
        return push(self, **chunks)

    monkeypatch.setattr(LiveStream, "push", interrupted)
    outcome = cli("task=stream", *stream, f"haptic={surfaces}/alpha/haptic/alpha_0.wav")
    assert outcome.status == 130
    assert len(outcome.out.splitlines()) == 11
    assert "epoch" not in outcome.err
