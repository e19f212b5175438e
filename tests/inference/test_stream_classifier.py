"""The stream against the whole recording, after every push."""

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
from tex_lightning.inference.stream_classifier import StreamingClassifier
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

RATE = 10_000
ENGINE = EngineConfig(True, True, True, True, "fp32", None)


def make_classifier(
    norm: str = "batch", sense: str = "haptic", **features: object
) -> SurfaceClassifier:
    """With random weights and statistics, so that labels differ from fragment to fragment."""
    torch.manual_seed(1)
    given = {"width": 0.1, "norm": norm, "sampling_rate": float(RATE), **features}
    card = make_card(sense, classes=["a", "b", "c"], **given)
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


def whole(classifier: SurfaceClassifier, trace: torch.Tensor):
    try:
        return classifier.classify(**{classifier.card.kind: trace})
    except UserError:
        return None


@pytest.mark.parametrize("norm", ["batch", "lrn", "none"])
@settings(max_examples=6)
@given(
    axes=st.sampled_from([1, 3]),
    touch=st.sampled_from([None, 0.0504, 0.3, 1.99, 2.5]),
    seed=st.integers(0, 99),
    chunks=st.lists(st.sampled_from([0, 1, 99, 500, 1601, 7000, 20_000]), min_size=1, max_size=9),
)
def test_every_push_gives_the_vote_of_the_whole(norm, axes, touch, seed, chunks):
    trace = recording(4.3, touch, axes, seed)
    classifier = make_classifier(norm)
    stream, place = StreamingClassifier(classifier), 0
    for chunk in [*chunks, 9000, 9000, 43_000]:
        voted = stream.push(trace[:, place : place + chunk])
        place += chunk
        expected = whole(classifier, trace[:, :place])
        assert (voted is None) == (expected is None)
        if voted is not None:
            assert torch.equal(voted.fragments, expected.fragments)
            assert voted.label == expected.label
            torch.testing.assert_close(voted.shares, expected.shares)


def test_a_classifier_prepared_by_the_engine_gives_the_same_votes():
    trace = recording(6.0, 0.4, 1, 0)
    for norm in ("batch", "lrn"):
        classifier = make_classifier(norm)
        stream = StreamingClassifier(accelerate(classifier, ENGINE))
        vote = [stream.push(chunk) for chunk in trace.split(1000, dim=1)][-1]
        assert torch.equal(vote.fragments, classifier.classify(haptic=trace).fragments)


def test_ties_are_decided_as_in_the_whole():
    classifier, trace, ties = make_classifier("none"), recording(12.0, None, 1, 1), 0
    with torch.no_grad():  # the first two classes share the fragments, about evenly
        scores = classifier.network.head.score_layer
        scores.weight[1] = -scores.weight[0]
        scores.bias[:2] = 0
        scores.bias[2] = -1e3
        ranked = classifier.logits(haptic=trace)[0].sort().values
        middle = len(ranked) // 2
        scores.bias[0] -= ranked[middle - 1 : middle + 1].mean()  # where rounding decides nothing
        scores.bias[1] = -scores.bias[0]
    stream = StreamingClassifier(classifier)
    for end in range(1200, 120_001, 1200):
        vote = stream.push(trace[:, end - 1200 : end])
        if vote is not None:
            assert vote.label == classifier.classify(haptic=trace[:, :end]).label
            ties += int((vote.shares == vote.shares.max()).sum()) == 2
    assert ties > 0


def test_what_a_stream_keeps_of_signal_and_layers_does_not_grow():
    stream, kept = StreamingClassifier(make_classifier("lrn")), []
    trace = recording(30.0, None, 1, 0)
    for part in (trace[:, :40_000], trace[:, 40_000:]):
        for chunk in part.split(1600, dim=1):
            stream.push(chunk)
        held = [layer.kept for layer in stream.layers]
        tensors = [item for item in (stream.rest, stream.beginning, *held) if item is not None]
        kept.append(sum(item.untyped_storage().nbytes() for item in tensors))
    assert kept[1] <= 1.1 * kept[0]


def test_every_frame_is_computed_once(monkeypatch):
    frames = []
    spectra = SpectrogramFeatures.spectra

    def counted(self, movement):
        found = spectra(self, movement)
        frames.append(found.shape[1])
        return found

    stream = StreamingClassifier(make_classifier(skip_impact=False))
    monkeypatch.setattr(SpectrogramFeatures, "spectra", counted)
    for chunk in recording(5.0, None, 1, 0).split(333, dim=1):
        stream.push(chunk)
    assert sum(frames) == (50_000 - 500) // 100 + 1


@pytest.mark.parametrize(
    ("senses", "features", "said"),
    [
        (["haptic"], {"axes": "trace"}, "axes=frame and normalisation=standard"),
        (["haptic"], {"normalisation": "paper"}, "axes=frame and normalisation=standard"),
        (["visual"], {"trunk": trunk_node("tcnn")}, "another VisualNet"),
        (["haptic", "sound"], {}, "another fusion network"),
    ],
)
def test_what_needs_the_whole_recording_is_refused(senses, features, said):
    card = make_card(*senses, width=0.1, norm="none", **features)
    with pytest.raises(UserError, match=said):
        StreamingClassifier(SurfaceClassifier(card))


def test_a_sense_of_other_windows_is_streamed_as_any_signal():
    classifier, trace = make_classifier(sense="sound"), recording(25.0, 0.3, 1, 2)
    features = classifier.senses["sound"].features
    assert (features.window_length, features.hop_length) == (400, 100)
    stream, counted = StreamingClassifier(classifier), 0
    for end in range(0, 250_000, 10_000):
        voted = stream.push(trace[:, end : end + 10_000])
        expected = whole(classifier, trace[:, : end + 10_000])
        assert (voted is None) == (expected is None)
        if voted is not None:
            assert torch.equal(voted.fragments, expected.fragments)
            counted += 1
    assert counted > 10


def test_a_checkpoint_that_averages_does_so_live():
    classifier, trace = make_classifier(), recording(4.3, None, 1, 0)
    classifier.card.decision["rule"] = "mean"
    stream = StreamingClassifier(classifier)
    counted = 0
    for end in range(22_000, 43_000, 500):
        voted = stream.push(trace[:, (end - 500 if end > 22_000 else 0) : end])
        if voted is not None:
            assert voted.label == classifier.classify(haptic=trace[:, :end]).label
            assert voted.label == int(voted.probabilities.argmax())
            counted += voted.label != int(voted.shares.argmax())
    assert counted  # votes alone would have given another label


def test_scores_that_are_nan_are_no_vote():
    classifier = make_classifier()
    torch.nn.init.constant_(classifier.network.head.score_layer.bias, torch.nan)
    with pytest.raises(UserError, match="NaN or infinite, so there is no decision"):
        StreamingClassifier(classifier).push(recording(2.0, None, 1, 0))
