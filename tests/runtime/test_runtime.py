"""The package's own predictions are the reference, field by field."""

import json
from copy import copy

import numpy as np
import onnx
import pytest
import soundfile
import torch
from conftest import RATE, make_photo, make_trace
from PIL import Image

import tex_lightning as tl
from tex_lightning_runtime import Runtime, UserError

TRACE, PHOTO = make_trace(0, 0), make_photo(0, 0, 480)


def same(found, expected):
    """Whether two predictions are equal to rounding, but for the time they took."""
    found, expected = (json.loads(json.dumps(each)) for each in (found, expected))
    del found["latency_ms"], expected["latency_ms"]
    assert [*found] == [*expected]
    for each in (found, expected):
        each["shares"] = [top.pop("share") for top in each["top_k"]]
    for name in ("shares", "probability", "probabilities", "confidence", "novelty"):
        assert found.pop(name, None) == pytest.approx(expected.pop(name, None), abs=1e-5)
    assert found == expected


def check(runtime, model, **given):
    same(runtime.predict(**given), model.predict(**given).to_dict())


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A trace at another rate, one of three axes, and a photo that lies on its side."""
    folder = tmp_path_factory.mktemp("files")
    soundfile.write(folder / "a.wav", TRACE, 8_000)
    axes = np.stack([make_trace(kind, 1) for kind in range(3)])
    np.savetxt(folder / "b.csv", axes.T, delimiter=",", header="x,y,z")
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(PHOTO[:471]).convert("RGBA").save(folder / "c.png", exif=exif)
    return folder


def test_tells_the_gain_after_a_rest_as_the_package_does(runtime, model):
    rest = 1e-4 * np.random.default_rng(0).standard_normal(4 * RATE)
    trace = np.concatenate((rest, 8 * np.tile(TRACE, 2))).astype(np.float32)
    features = model.classifier.senses["haptic"].features
    magnitudes = features.magnitudes(torch.from_numpy(trace)[None])
    gains = features.known_gain(magnitudes)[0] / magnitudes[0]
    assert gains.round(decimals=3).unique().numel() == 2
    check(runtime, model, haptic=trace, image=PHOTO)


@pytest.mark.parametrize("trace", ["a.wav", "b.csv"])
def test_predicts_of_files_as_the_package_does(runtime, model, files, trace):
    check(runtime, model, haptic=files / trace, image=str(files / "c.png"))


@pytest.mark.parametrize("trace", [0 * TRACE, TRACE.clip(-0.1, 0.1), 100 * TRACE])
@pytest.mark.parametrize("photo", [0 * PHOTO, PHOTO // 8])
def test_warns_as_the_package_does(runtime, model, trace, photo):
    check(runtime, model, haptic=trace, image=photo)


def test_lists_as_many_classes_as_the_package_does(exported, runtime, monkeypatch):
    monkeypatch.setattr(runtime, "_top_k", 2)
    check(runtime, tl.load(exported[0], "top_k=2"), haptic=TRACE, image=PHOTO)


def test_what_is_novel_is_called_unknown_as_by_the_package(runtime, model):
    rng = np.random.default_rng(0)
    strange = {"haptic": rng.standard_normal(TRACE.shape), "image": 255 - PHOTO}
    check(runtime, model, **strange)
    check(runtime, model, haptic=TRACE, image=PHOTO)
    said = [runtime.predict(**strange), runtime.predict(haptic=TRACE, image=PHOTO)]
    assert [each["label"] == "unknown" for each in said] == [True, False]


def test_all_senses_are_needed(runtime):
    for given in ({}, {"haptic": TRACE}):
        with pytest.raises(UserError, match=r"needs haptic and image; give .*image too"):
            runtime.predict(**given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"haptic": TRACE[:2000], "image": PHOTO}, "less movement than the 1.81 s"),
        ({"haptic": TRACE, "image": PHOTO[:100]}, "240x50 pixels"),
        ({"sound": TRACE}, "does not look at sound"),
        ({"haptic": "nowhere.wav"}, "nowhere.wav"),
        ({"haptic": TRACE, "rate": -1.0}, "rate"),
        ({"haptic": [[1, 2], [3]]}, "trace"),
    ],
)
def test_refuses_in_one_sentence(runtime, model, given, message):
    with pytest.raises(tl.UserError):
        model.predict(**given)
    with pytest.raises(UserError, match=message) as caught:
        runtime.predict(**given)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [None, b"", b"words"])
def test_refuses_what_is_no_exported_file(tmp_path, content):
    path = tmp_path / "a.onnx"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(UserError, match="no file of task=export"):
        Runtime(path)


@pytest.mark.parametrize("key", ["pairs", "seed"])
@pytest.mark.parametrize("value", [10**12, -1, 0.5, "many", None])
def test_refuses_a_card_whose_draws_would_not_fit(tmp_path, key, value):
    value_info = onnx.helper.make_tensor_value_info("x", onnx.TensorProto.FLOAT, [1])
    graph = onnx.helper.make_graph([], "nothing", [value_info], [value_info])
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)])
    model.ir_version = 8
    decision = {"pairs": 200, "seed": 0, key: value}
    card = json.dumps({"format": 2, "decision": decision, "senses": []})
    model.metadata_props.add(key="tex_lightning", value=card)
    onnx.save(model, tmp_path / "a.onnx")
    with pytest.raises(UserError, match=r"pairs from .*; export it anew"):
        Runtime(tmp_path / "a.onnx")


@pytest.mark.parametrize("rate", [RATE, 4_410])
@pytest.mark.parametrize("window", [None, 2.0])
def test_a_stream_predicts_what_its_samples_would(runtime, rate, window):
    samples = np.stack([make_trace(kind, 2, 6.0) for kind in range(3)])
    kept = samples.shape[1] if window is None else round(window * rate)
    stream = runtime.stream(window, rate=rate, image=PHOTO)
    end, labels = 0, []
    for chunk in np.array_split(samples, [1_000, 1_001, 9_000, 24_000, 24_500], axis=1):
        found, end = stream.push(chunk), end + chunk.shape[1]
        labels.append(found["label"])
        if found["fragments"]:
            begin = max(0, end - kept)
            same(found, runtime.predict(haptic=samples[:, begin:end], image=PHOTO, rate=rate))
    assert labels[0] is None
    assert labels[-1] is not None
    with pytest.raises(UserError, match="had 3 axes before"):
        stream.push(samples[0])


def test_of_several_signals_the_one_that_is_too_short_is_named(runtime):
    several, haptic = copy(runtime), runtime.senses["haptic"]
    sound = {**haptic, "modality": "sound", "too_short": "The sound is too short."}
    several.senses = {**runtime.senses, "sound": sound}
    with pytest.raises(UserError, match=r"^The sound is too short\.$"):
        several.predict(haptic=TRACE, image=PHOTO, sound=TRACE[:50])
