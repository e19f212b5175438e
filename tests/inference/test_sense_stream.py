"""The stream of one sense against the whole recording, after every push."""

import numpy as np
import pytest
import torch
from conftest import make_card, trunk_node
from hypothesis import given, settings
from hypothesis import strategies as st

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.sense_stream import SenseStream
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

RATE = 10_000
ENGINE = EngineConfig(True, True, True, True, "fp32", None)


def make_classifier(
    norm: str = "batch", sense: str = "haptic", **features: object
) -> SurfaceClassifier:
    """With random weights and statistics, so that labels differ from fragment to fragment."""
    torch.manual_seed(1)
    settings = {"width": 0.1, "norm": norm, "sampling_rate": float(RATE), **features}
    card = make_card(sense, classes=["a", "b", "c"], **settings)
    classifier = SurfaceClassifier(card)
    for module in classifier.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.normal_(module.running_mean)
            torch.nn.init.uniform_(module.running_var, 0.5, 2)
            torch.nn.init.normal_(module.weight)
    scores = classifier.eval().network.head.score_layer
    torch.nn.init.normal_(scores.weight)
    with torch.no_grad():  # no class wins every fragment
        known = recording(4.3 if sense == "haptic" else 12.0, None, 1, 0)
        scores.bias.sub_(classifier.logits(**{sense: known}).mean(dim=1))
    return classifier


def recording(seconds: float, touch: float | None, axes: int, seed: int) -> torch.Tensor:
    """Quiet up to the touch, then movement whose colour changes; None moves from the start."""
    rng = np.random.default_rng(seed)
    samples = int(seconds * RATE)
    time = np.arange(samples) / RATE
    moving = rng.standard_normal((axes, samples)) * (1 + np.sin(9 * time))
    moving += np.sin(2 * np.pi * (100 + 80 * time) * time)
    if touch is not None:
        moving *= np.where(time < touch, 1e-3, 1)
    return torch.from_numpy(moving + 9.8).float()


def same_as_whole(stream: SenseStream, classifier: SurfaceClassifier, trace: torch.Tensor) -> bool:
    """Compare the scores so far with those of the recording so far; whether there are some."""
    try:
        expected = classifier.logits(**{stream.name: trace})
    except UserError:
        assert stream.output is None
        return False
    torch.testing.assert_close(stream.output.partial_logits, expected, rtol=1e-4, atol=1e-4)
    return True


@pytest.mark.parametrize("norm", ["batch", "lrn"])
@settings(max_examples=6)
@given(
    axes=st.sampled_from([1, 3]),
    touch=st.sampled_from([None, 0.0504, 0.3, 1.99, 2.5]),
    seed=st.integers(0, 99),
    chunks=st.lists(st.sampled_from([0, 1, 99, 500, 1601, 7000, 20_000]), min_size=1, max_size=9),
)
def test_every_push_gives_the_scores_of_the_whole(norm, axes, touch, seed, chunks):
    trace, classifier = recording(4.3, touch, axes, seed), make_classifier(norm)
    stream, end = SenseStream(accelerate(classifier, ENGINE), "haptic"), 0
    for chunk in [*chunks, 9000, 9000, 43_000]:
        stream.push(trace[:, end : end + chunk])
        end += chunk
        same_as_whole(stream, classifier, trace[:, :end])


def test_a_sense_of_other_windows_is_streamed_as_any_signal():
    classifier, trace = make_classifier(sense="sound"), recording(25.0, 0.3, 1, 2)
    features = classifier.senses["sound"].features
    assert (features.window_length, features.hop_length) == (400, 100)
    stream, compared = SenseStream(classifier, "sound"), 0
    for end in range(10_000, 250_001, 10_000):
        stream.push(trace[:, end - 10_000 : end])
        compared += same_as_whole(stream, classifier, trace[:, :end])
    assert compared > 10


def test_frames_are_computed_once_and_few_are_kept(monkeypatch):
    frames, kept, magnitudes = [], [], SpectrogramFeatures.magnitudes

    def counted(self, movement, start):
        found = magnitudes(self, movement, start)
        frames.append(found.shape[1])
        return found

    stream = SenseStream(make_classifier(skip_impact=False), "haptic")
    monkeypatch.setattr(SpectrogramFeatures, "magnitudes", counted)
    for chunk in recording(10.0, None, 1, 0).split(1600, dim=1):
        stream.push(chunk)
        kept.append(sum(each.untyped_storage().nbytes() for each in (stream.rest, stream.tail)))
    assert sum(frames) == (100_000 - 500) // 100 + 1
    assert max(kept[20:]) <= max(kept[:20])


@pytest.mark.parametrize(
    ("sense", "features"),
    [
        ("haptic", {"axes": "trace"}),
        ("haptic", {"normalisation": "paper"}),
        ("visual", {"trunk": trunk_node("tcnn")}),
    ],
)
def test_what_needs_the_whole_recording_is_refused(sense, features):
    card = make_card(sense, width=0.1, norm="none", **features)
    with pytest.raises(UserError, match="axes=frame and normalisation=standard"):
        SenseStream(SurfaceClassifier(card), sense)
