"""A vote over the last seconds: what votes, when it forgets, and that it stays small."""

import numpy as np
import pytest
import torch
from conftest import RATE, make_card, make_trace
from hypothesis import given, settings
from hypothesis import strategies as st

import tex_lightning as tl
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import StreamConfig
from tex_lightning.errors import UserError
from tex_lightning.inference.stream import LiveStream

CHUNK = RATE // 10


def make_stream(window=2.0, **features) -> LiveStream:
    """Of a HapticNet with random weights that takes traces of a level from 1 on."""
    torch.manual_seed(0)
    card = make_card("haptic", classes=["a", "b", "c"], width=0.1, **features)
    card.input_ranges["haptic"] = {"level": [1.0, 5.0], "rate": [RATE, RATE]}
    config = StreamConfig(chunk=0.1, window=window, axes=1)
    classifier = SurfaceClassifier(card).eval()
    return LiveStream(classifier, {"haptic": None}, {}, config, top_k=3)


def noise(seconds: float, level: float = 2.0, axes: int = 1) -> np.ndarray:
    rng = np.random.default_rng(round(1000 * seconds))
    samples = level * rng.standard_normal((axes, round(seconds * RATE))) + 9.8
    return samples.astype(np.float32)


@pytest.mark.parametrize("axes", [1, 3])
def test_the_last_seconds_vote_as_if_there_were_no_others(axes):
    stream, trace = make_stream(window=2.5, skip_impact=False), noise(4.05, axes=axes)
    for end in range(CHUNK, trace.shape[1] + CHUNK, CHUNK):
        found = stream.push(trace[:, end - CHUNK : end])
    vote = stream.classifier.classify(haptic=torch.from_numpy(trace[:, 15_500:]))
    assert found.fragments == len(vote.fragments)
    assert found.probability == pytest.approx(vote.probability)


@settings(max_examples=8)
@given(chunks=st.lists(st.sampled_from([1, 99, 1000, 1601, 7000]), max_size=9))
def test_chunks_do_not_matter(chunks):
    trace = np.concatenate((noise(2.0), noise(0.5, 1e-3), noise(1.2)), axis=1)
    stream, place = make_stream(), 0
    expected = make_stream().push(trace)
    for chunk in [*chunks, trace.shape[1]]:
        found = stream.push(trace[:, place : place + chunk])
        place += chunk
    assert found.probability == expected.probability


def test_the_label_follows_the_surface_and_a_pause_is_warned_of(bands):
    pause = 1e-4 * np.random.default_rng(0).standard_normal(RATE)
    joined = np.concatenate([make_trace(0, 0, 2.0), pause, make_trace(2, 0, 2.0)])
    stream = tl.load(bands, "stream.window=0.8").stream()
    said = [stream.push(joined[start : start + CHUNK]) for start in range(0, len(joined), CHUNK)]
    assert {each.label for each in said[5:20]} == {"alpha"}
    assert {each.label for each in said[39:]} == {"gamma"}
    assert [bool(each.warnings) for each in (said[19], said[28], said[39])] == [False, True, False]


def test_what_prevents_a_vote_is_said_in_the_end():
    stream = make_stream()
    with pytest.raises(UserError, match="ended before the first fragment"):
        stream.check()

    def refuse(*_):
        raise UserError("Too short.")

    stream._output = refuse
    assert stream.push(noise(1.0)).label is None
    with pytest.raises(UserError, match="Too short"):
        stream.check()
