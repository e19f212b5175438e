"""Samples as they are shown: traces, sounds, maps of the fragments, and which are the worst."""

import json

import numpy as np
import pytest
import torch

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report import samples
from tex_lightning.report.samples import draw_trace, worst


def test_a_trace_is_drawn_where_its_values_are():
    signal = np.zeros((1, 3200), np.float32)
    signal[0, 1600:1700] = 1  # upwards in the middle
    dark = (draw_trace(signal) < 255).any(axis=2)
    tops = dark.argmax(axis=0)
    assert tops[165] < 5
    assert abs(int(tops[10]) - dark.shape[0] // 2) < 5
    assert dark.any(axis=0).all()


@pytest.mark.parametrize("samples_", [1, 7, 100_001])
def test_any_length_of_a_trace_is_drawn(samples_):
    assert draw_trace(np.random.default_rng(0).normal(size=(3, samples_))).shape == (64, 320, 3)


@pytest.mark.parametrize("rate", [50.0, 1000.0, 44_100.0])
def test_a_sound_has_pitch_and_length_of_the_recording(rate):
    tone = rate / 10
    times = np.arange(int(2 * rate)) / rate
    signal = (5 + 0.1 * np.sin(2 * np.pi * tone * times)).astype(np.float32)[None]
    decoder = SignalDecoder(rate, rate, None, None, assumes=False)
    sound, played = samples._sound(signal, decoder)
    assert played >= 8000  # which browsers play
    assert len(sound) / played == pytest.approx(2, rel=0.02)
    assert np.abs(sound).max() == pytest.approx(1, abs=0.02)
    spectrum = np.abs(np.fft.rfft(sound))
    assert spectrum.argmax() * played / len(sound) == pytest.approx(tone, rel=0.02)


def outcome(label: str, predicted: str, **probabilities: float) -> Outcome:
    known = json.dumps(probabilities)
    return Outcome({"haptic": "a"}, label, predicted, 1, 1, 1, 1.0, probabilities=known)


def test_errors_come_first_and_the_surest_of_them_before_others():
    outcomes = [
        outcome("a", "a", a=0.9, b=0.1), outcome("a", "b", a=0.4, b=0.6),
        outcome("a", "a", a=0.5, b=0.5), outcome("a", "b", a=0.1, b=0.9),
    ]  # fmt: skip
    assert worst(outcomes, 3) == [3, 1, 2]


def test_a_map_has_the_classes_that_the_fragments_are_given(fused, surfaces):
    classifier = SurfaceClassifier.from_checkpoint(fused / "checkpoints" / "visual.ckpt")
    file = surfaces / "alpha" / "image" / "alpha_0.png"
    decoder = classifier.senses["visual"].decoder
    photo = decoder.decode(file)[0]
    logits = classifier.logits(image=torch.from_numpy(np.array(photo)))
    expected = logits.argmax(dim=0)
    predicted = classifier.card.classes[int(expected.mode().values)]
    sample = Sample("alpha", {"image": Recording("alpha", "image", file, 0)})

    class Store:
        def load(self, _: Recording) -> np.ndarray:
            return photo

    made = Outcome({"image": str(file)}, "alpha", predicted, 1, 1, 1, 1.0)
    shown = samples.show_sample(classifier, sample, made, Store())
    colours = shown.senses["visual"].pictures["classes"].reshape(-1, 3)
    for name, colour in {predicted: samples.LABEL, "alpha": samples.TRUE}.items():
        share = float((expected == classifier.card.classes.index(name)).float().mean())
        assert (colours == colour).all(axis=1).mean() == pytest.approx(share, abs=0.05)


def test_a_long_class_is_shown_with_its_end_and_its_probability(monkeypatch):
    rows = []
    monkeypatch.setattr(samples, "captioned", rows.extend)
    made = outcome("a" * 90 + "z", "b", b=0.25)
    samples.sample_picture(samples.ShownSample(made, {}))
    (label, _), (called, _), _ = rows
    assert label.endswith("z (0%)")
    assert len(label) < 50
    assert called == "called b (25%)"
