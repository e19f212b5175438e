"""The Python door: files and arrays in, predictions out."""

from dataclasses import replace

import numpy as np
import pytest
import soundfile
import torch
from conftest import RATE, make_card, make_photo, make_trace, save_checkpoint
from PIL import Image

import tex_lightning as tl

TRACE, PHOTO = make_trace(0, 0), make_photo(1, 0)
PHOTO[..., 0] //= 2  # so that the order of colours matters


@pytest.fixture(scope="module")
def haptic(untrained):
    return tl.load(untrained / "checkpoints" / "haptic.ckpt")


@pytest.fixture(scope="module")
def fusion(untrained):
    return tl.load(untrained, "top_k=2")


def essence(prediction):
    return prediction.label, prediction.probability, prediction.confidence, prediction.fragments


def test_a_trace_is_the_same_in_every_form(haptic, tmp_path):
    np.save(tmp_path / "a.npy", TRACE)
    from_file = haptic.predict(haptic=tmp_path / "a.npy")
    assert from_file.fragments == 4
    for form in (
        str(tmp_path / "a.npy"), TRACE, TRACE.astype(np.float64), torch.from_numpy(TRACE),
        TRACE.tolist(), TRACE[None], TRACE[:, None],
    ):  # fmt: skip
        assert essence(haptic.predict(haptic=form)) == essence(from_file)
    three = np.stack([TRACE, TRACE[::-1], TRACE * 0.5])
    assert essence(haptic.predict(haptic=three)) == essence(haptic.predict(haptic=three.T))


def test_the_rate_of_an_array_is_that_of_a_file(haptic, tmp_path):
    fast = np.interp(np.arange(48_000) / 2, np.arange(24_000), TRACE).astype(np.float32)
    soundfile.write(tmp_path / "fast.wav", fast, 2 * RATE, subtype="FLOAT")
    from_file = haptic.predict(haptic=tmp_path / "fast.wav")
    assert from_file.fragments == 4
    from_array = haptic.predict(haptic=fast, rate=2 * RATE)
    assert (from_array.label, from_array.fragments) == (from_file.label, 4)
    assert from_array.probability == pytest.approx(from_file.probability, abs=1e-6)
    assert haptic.predict(haptic=fast).fragments > 4


def test_a_photo_is_the_same_in_every_form(fusion, tmp_path):
    Image.fromarray(PHOTO).save(tmp_path / "a.png")
    from_file = fusion.predict(haptic=TRACE, image=tmp_path / "a.png")
    assert from_file.modalities == ("haptic", "image")
    assert len(from_file.top_k) == 2
    for form, colour in (
        (PHOTO, "rgb"),
        (torch.from_numpy(PHOTO), "rgb"),
        (PHOTO[..., ::-1], "bgr"),
    ):
        found = fusion.predict(haptic=TRACE, image=form, colour=colour)
        assert essence(found) == essence(from_file)
    alone = fusion.predict(image=PHOTO)
    assert alone.modalities == ("image",)
    grey = np.ascontiguousarray(PHOTO[..., 1])
    as_colours = np.repeat(grey[..., None], 3, axis=2)
    assert essence(fusion.predict(image=grey)) == essence(fusion.predict(image=as_colours))


@pytest.mark.parametrize("decision", ["max_vote", "sequential"])
def test_what_decides_by_some_senses_is_chosen_and_not_built(untrained, monkeypatch, decision):
    loaded = tl.load(untrained, f"decision={decision}")
    trained = loaded.classifier.senses
    parts = {names: getattr(part, "full", part) for names, part in loaded.deciders.items()}
    for name, sense in parts["haptic", "visual"].senses.items():
        alone = parts[name,].senses[name]
        assert alone.features is sense.features
        shared = {id(weight) for weight in sense.network.parameters()}
        own = [weight for weight in alone.network.parameters() if id(weight) not in shared]
        assert [weight.shape[:1] for weight in own] == [(3,), (3,)]  # of the scores
        assert not shared & {id(weight) for weight in trained[name].network.parameters()}

    def build(*_, **__):
        raise AssertionError("a classifier or a copy was made inside of a prediction")

    for place in (
        "classifier.classifier.SurfaceClassifier.__init__", "classifier.classifier.shared_copy",
        "networks.fusionnet.deepcopy", "networks.fusionnet.independent_copy",
        "networks.fusionnet.shared_copy",
    ):  # fmt: skip
        monkeypatch.setattr(f"tex_lightning.{place}", build)
    both, haptic = loaded.predict(haptic=TRACE, image=PHOTO), loaded.predict(haptic=TRACE)
    assert (both.fragments, haptic.modalities) == (50, ("haptic",))
    assert loaded.predict(image=PHOTO).modalities == ("image",)
    assert loaded.stream("haptic").push(TRACE).label == haptic.label


@pytest.mark.parametrize("rule", ["vote", "mean", "score"])
def test_a_stream_ends_with_the_prediction_of_the_whole(untrained, rule):
    haptic = tl.load(untrained / "checkpoints" / "haptic.ckpt", f"decision.rule={rule}")
    stream = haptic.stream()
    first, *_, last = (stream.push(TRACE[start : start + 2500]) for start in range(0, 24_000, 2500))
    assert (first.label, first.probability, first.fragments) == (None, None, 0)
    whole = haptic.predict(haptic=TRACE)
    assert last.label == whole.label
    assert last.probability == pytest.approx(whole.probability)
    assert last.fragments == whole.fragments


def test_a_chunk_with_other_axes_is_refused(haptic):
    stream = haptic.stream()
    three = np.ones((3, 500))
    with pytest.raises(tl.UserError, match=r"shape \(500, 3\); give \(axes, samples\)"):
        stream.push(three.T)
    stream.push(three)
    stream.push(three[:, :1])
    for chunk in (TRACE, TRACE[None], three[:, :1].T):
        with pytest.raises(tl.UserError, match="as many axes as before, 3"):
            stream.push(chunk)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({}, "nothing to classify"),
        ({"haptic": np.zeros((2, 5, 3))}, r"shape \(2, 5, 3\)"),
        ({"haptic": []}, "at least one sample"),
        ({"haptic": TRACE * np.nan}, "NaN, infinity or a number beyond 1e.09 at sample 0"),
        ({"haptic": np.ones(9, complex)}, "complex128; give numbers"),
        ({"haptic": ["a.wav", "b.wav"]}, "give numbers"),
        ({"haptic": [[1, 2], [3]]}, "cannot be read as an array"),
        ({"haptic": TRACE[:10_000]}, r"1\.00 s of movement, and HapticNet needs 1\.81 s"),
        ({"haptic": TRACE, "rate": 0}, "a sampling rate of 0 Hz, too far from"),
        ({"haptic": "gone.wav"}, "gone.wav does not exist"),
        ({"image": PHOTO / 255.0}, "float64 of the shape .* give uint8"),
        ({"image": PHOTO.transpose(2, 0, 1)}, "colours last"),
        ({"image": PHOTO[:0]}, "image is an array of uint8 of the shape"),
        ({"image": PHOTO, "colour": "hsv"}, "choose rgb or bgr"),
        ({"image": PHOTO[:50]}, "pixels after decoding"),
    ],
)
def test_what_cannot_be_used_is_said_in_one_sentence(fusion, given, said):
    with pytest.raises(tl.UserError, match=said):
        fusion.predict(**given)


@pytest.mark.parametrize("override", ["tpo_k=3", "top_k=0", "engine=fast", "task=fit"])
def test_overrides_that_cannot_be_meant_are_said(untrained, override):
    with pytest.raises(tl.UserError, match=override.partition("=")[0]):
        tl.load(untrained, override)


def test_a_stream_adds_what_a_photo_says_once(fusion):
    stream = fusion.stream("haptic", image=PHOTO)
    *_, last = (stream.push(part) for part in np.split(TRACE, 8))
    assert (last.modalities, last.fragments) == (("haptic", "image"), 50)
    classifier = fusion.classifier
    trace, photo = torch.from_numpy(TRACE)[None], torch.from_numpy(PHOTO)
    photo = photo[::2, ::2] if classifier.senses["visual"].decoder.half_scale else photo
    with torch.inference_mode():
        partials = (
            classifier.partial_logits("haptic", trace),
            classifier.partial_logits("visual", photo),
        )
        vote = classifier.decide(classifier.fuse(partials, classifier.card.decision["seed"]), 1.0)
    assert last.label == fusion.card.classes[vote.label]
    assert last.probability == pytest.approx(vote.probability, abs=1e-5)
    alone, expected = fusion.stream("haptic").push(TRACE), fusion.predict(haptic=TRACE)
    assert (alone.label, alone.fragments) == (expected.label, expected.fragments)
    assert alone.probability == pytest.approx(expected.probability)


def test_signals_of_a_stream_come_together(tmp_path):
    save_checkpoint(make_card("haptic", "sound", width=0.1), tmp_path / "fusion.ckpt")
    sound = np.random.default_rng(0).standard_normal(105_840).astype(np.float32)
    for window, fragments in (("null", 50), ("1", 50)):
        stream = tl.load(tmp_path / "fusion.ckpt", f"stream.window={window}").stream()
        for trace, heard in zip(np.split(TRACE, 24), np.split(sound, 24), strict=True):
            found = stream.push(haptic=trace, sound=heard)
        assert (found.modalities, found.fragments) == (("haptic", "sound"), fragments)
        with pytest.raises(tl.UserError, match="takes haptic and sound with every push"):
            stream.push(TRACE)


def test_many_are_predicted_as_each_alone(bands, surfaces):
    model = tl.load(bands)
    files = sorted(surfaces.glob("*/haptic/*_0.wav"))
    many = model.predict_many(haptic=files)
    alone = [model.predict(haptic=file) for file in files]
    assert [replace(found, latency_ms=0) for found in many] == [
        replace(found, latency_ms=0) for found in alone
    ]
    with pytest.raises(tl.UserError, match="2 of haptic, 1 of image"):
        model.predict_many(haptic=files[:2], image=files[:1])
    with pytest.raises(tl.UserError, match=r"^Sample 1 \(from 0\): .*nowhere"):
        model.predict_many(haptic=[files[0], "nowhere.wav"])
    assert len(model.predict_many(haptic=surfaces.glob("*/haptic/*_0.wav"))) == len(files)
    for one in (files[0], str(files[0])):
        with pytest.raises(tl.UserError, match=r"^haptic is .*_0\.wav; give a list, of one path"):
            model.predict_many(haptic=one)
    with pytest.raises(tl.UserError, match=r"^haptic has a rate of '10000'; give a number in Hz"):
        model.predict(haptic=TRACE, rate="10000")


def test_a_model_says_what_it_is_and_how_good_it_was(bands):
    model = tl.load(bands)
    assert model.classes == ["alpha", "beta", "gamma"]
    said = repr(model)
    assert "3 classes (alpha, beta, gamma)" in said
    assert "takes haptic at 10,000 Hz" in said
    assert "folds" not in said
    known = {"vote_accuracy": 0.9, "correct": 27, "test_samples": 30, "vote_ci95": [0.74, 0.97]}
    training = {**model.card.training, "crossval": {**known, "folds": 10}}
    model.card = replace(model.card, training=training)
    assert "90.0% (27/30, 74.0% to 97.0%) in 10 folds" in repr(model)
