"""Live classification through the command line."""

import io
import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import soundfile
from conftest import RATE, make_photo, make_trace
from PIL import Image
from scipy.signal import resample_poly

from tex_lightning.inference.sense_stream import SenseStream


@pytest.fixture
def checkpoint(fused):
    return fused / "checkpoints" / "haptic.ckpt"


def lines(outcome) -> list[dict]:
    assert outcome.status == 0, outcome.err
    return [json.loads(line) for line in outcome.out.splitlines()]


def test_a_replayed_file_ends_with_the_label_of_predict(cli, checkpoint, tmp_path):
    wav = tmp_path / "a.wav"
    soundfile.write(wav, make_trace(1, 42, seconds=3.05), RATE, subtype="FLOAT")
    common = [f"checkpoint={checkpoint}", f"haptic={wav}", f"hydra.run.dir={tmp_path / 'run'}"]
    said = lines(cli("task=stream", *common, "stream.chunk=0.25"))
    (whole,) = lines(cli("task=predict", *common))
    assert [line["time"] for line in said] == [*(0.25 * n for n in range(1, 13)), 3.05]
    assert said[0]["label"] is None
    assert said[0]["fragments"] == 0
    assert {key: said[-1][key] for key in ("label", "confidence", "fragments")} == {
        key: whole[key] for key in ("label", "confidence", "fragments")
    }


def pipe(monkeypatch, content: bytes) -> None:
    monkeypatch.setattr(sys, "stdin", SimpleNamespace(buffer=io.BytesIO(content)))


def test_samples_from_standard_input(cli, checkpoint, tmp_path, monkeypatch):
    samples = np.stack([make_trace(0, n, seconds=2.5) for n in range(3)])
    np.save(tmp_path / "a.npy", samples)
    pipe(monkeypatch, samples.T.astype("<f4").tobytes())
    common = [f"checkpoint={checkpoint}", f"hydra.run.dir={tmp_path / 'run'}"]
    said = lines(cli("task=stream", *common, "haptic=-", "stream.axes=3"))
    (whole,) = lines(cli("task=predict", *common, f"haptic={tmp_path / 'a.npy'}"))
    assert len(said) == 25
    assert (said[-1]["label"], said[-1]["fragments"]) == (whole["label"], whole["fragments"])


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["haptic=/no.wav"], "/no.wav does not exist"),
        (["haptic=[a.wav,b.wav]"], "give one file"),
        (["haptic=-", "stream.chunk=0"], "stream.chunk is 0: choose more than 0"),
        (["haptic=-", "engine.precision=bf16"], "computed in float32"),
        (["haptic=-", "image=a.jpg"], "does not look at image"),
        (["haptic=-", "sound=-"], "only one signal can be standard input"),
        (["haptic=-", "stream.window=2"], "too soon for a vote"),
        (["haptic=-", "data.file_rate=1"], "data.file_rate is 1"),
        (["haptic=-"], "record a longer stroke"),
        ([], "give haptic=FILE, or haptic=-"),
    ],
)
def test_mistakes_are_told(cli, checkpoint, tmp_path, monkeypatch, arguments, said):
    pipe(monkeypatch, b"")
    run = f"hydra.run.dir={tmp_path / 'run'}"
    outcome = cli("task=stream", f"checkpoint={checkpoint}", run, *arguments)
    assert outcome.status == 2
    assert said in outcome.err
    assert "Traceback" not in outcome.err


def test_another_rate_is_resampled_on_the_way(cli, checkpoint, tmp_path, monkeypatch):
    wav, rate = tmp_path / "a.wav", 16_000
    samples = resample_poly(make_trace(1, 42, seconds=3.05), rate, RATE).astype("<f4")
    soundfile.write(wav, samples, rate, subtype="FLOAT")
    pipe(monkeypatch, samples.tobytes())
    common = [f"checkpoint={checkpoint}", f"hydra.run.dir={tmp_path / 'run'}"]
    from_file = lines(cli("task=stream", *common, f"haptic={wav}"))
    from_pipe = lines(cli("task=stream", *common, "haptic=-", f"data.file_rate={rate}"))
    (whole,) = lines(cli("task=predict", *common, f"haptic={wav}"))
    keys = ("label", "confidence", "fragments")
    for said in (from_file, from_pipe):
        assert [line["time"] for line in said[-3:]] == [3.0, 3.05, 3.05]  # the last of the filter
        assert [said[-1][key] for key in keys] == [whole[key] for key in keys]
        assert said[-1]["probability"] == pytest.approx(whole["probability"], abs=1e-6)


def test_the_label_of_a_window_follows_the_tool(cli, bands, tmp_path):
    trace = np.concatenate([make_trace(0, 42, 4.0), make_trace(1, 42, 4.0)])
    soundfile.write(tmp_path / "a.wav", trace, RATE, subtype="FLOAT")
    run = f"hydra.run.dir={tmp_path / 'run'}"
    common = [f"checkpoint={bands}", f"haptic={tmp_path / 'a.wav'}", run]
    said = lines(cli("task=stream", *common, "stream.window=1"))
    labels = [line["label"] for line in said]
    assert set(labels[2:40]) == {"alpha"}
    assert set(labels[50:]) == {"beta"}
    assert all(line["contact"] for line in said)


def test_a_photo_and_two_files_are_joined_with_the_live_trace(cli, untrained, tmp_path):
    soundfile.write(tmp_path / "a.wav", make_trace(1, 42, seconds=3.0), RATE, subtype="FLOAT")
    Image.fromarray(make_photo(1, 0)).save(tmp_path / "a.png")
    fusion = untrained / "checkpoints" / "fusion.ckpt"
    common = ["task=stream", f"checkpoint={fusion}", f"hydra.run.dir={tmp_path / 'run'}"]
    trace, photo = f"haptic={tmp_path / 'a.wav'}", f"image={tmp_path / 'a.png'}"
    for more in ([], ["stream.window=1"]):
        said = lines(cli(*common, trace, photo, *more))
        assert [line["time"] for line in said] == [round(0.1 * n, 1) for n in range(1, 31)]
        assert said[-1]["fragments"] == 50
    assert lines(cli(*common, trace))[-1]["fragments"] < 50
    for wrong, why in ((photo, "give a signal too"), ("sound=-", "does not look at sound")):
        outcome = cli(*common, wrong)
        assert (outcome.status, why in outcome.err) == (2, True)


def test_ctrl_c_ends_it_as_elsewhere(cli, checkpoint, surfaces, tmp_path, monkeypatch):
    push = SenseStream.push

    def interrupted(self, chunk):
        if self.frames > 100:
            raise KeyboardInterrupt
        return push(self, chunk)

    monkeypatch.setattr(SenseStream, "push", interrupted)
    wav, run = surfaces / "alpha" / "haptic" / "alpha_0.wav", f"hydra.run.dir={tmp_path / 'run'}"
    outcome = cli("task=stream", f"checkpoint={checkpoint}", f"haptic={wav}", run)
    assert outcome.status == 130
    assert len(outcome.out.splitlines()) == 11
    assert "epoch" not in outcome.err


def test_not_a_number_on_standard_input_is_refused(cli, checkpoint, tmp_path, monkeypatch):
    pipe(monkeypatch, np.full(5000, np.nan, "<f4").tobytes())
    run = f"hydra.run.dir={tmp_path / 'run'}"
    outcome = cli("task=stream", f"checkpoint={checkpoint}", "haptic=-", run)
    assert outcome.status == 2
    assert "NaN, infinity or a number beyond 1e+09 at sample 0" in outcome.err


def test_a_label_that_is_not_sure_is_rejected_as_in_predict(cli, checkpoint, tmp_path):
    wav = tmp_path / "a.wav"
    soundfile.write(wav, make_trace(1, 42, seconds=3.05), RATE, subtype="FLOAT")
    common = [f"checkpoint={checkpoint}", f"haptic={wav}", f"hydra.run.dir={tmp_path / 'run'}"]
    said = lines(cli("task=stream", *common, "decision.reject_below=1"))
    (whole,) = lines(cli("task=predict", *common, "decision.reject_below=1"))
    assert (whole["label"], whole["rejected"]) == (None, True)
    assert (said[-1]["label"], said[-1]["rejected"]) == (None, True)
    assert said[0]["rejected"] is False
