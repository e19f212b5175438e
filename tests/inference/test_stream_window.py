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
from tex_lightning.inference.stream_window import WindowVote

CHUNK = RATE // 10


def make_stream(window=2.0, odds=None, contact=0.1, fixed=None, **features) -> WindowVote:
    """Of a HapticNet with random weights that takes traces of a level from 1 on."""
    torch.manual_seed(0)
    card = make_card("haptic", classes=["a", "b", "c"], width=0.1, **features)
    card.input_ranges["haptic"] = {"level": [1.0, 5.0], "rate": [RATE, RATE]}
    config = StreamConfig(chunk=0.1, wait=0, window=window, odds=odds, contact=contact, axes=1)
    return WindowVote(SurfaceClassifier(card).eval(), fixed or {}, config)


def noise(seconds: float, level: float = 2.0, axes: int = 1) -> torch.Tensor:
    rng = np.random.default_rng(round(1000 * seconds))
    samples = level * rng.standard_normal((axes, round(seconds * RATE))) + 9.8
    return torch.from_numpy(samples).float()


@pytest.fixture(scope="module")
def surface(bands):
    """Votes of the rule fitted to the surfaces."""
    return lambda: tl.load(bands, "stream.window=2", "stream.odds=4").stream()


def labels(stream, trace: np.ndarray) -> list:
    return [stream.push(trace[start : start + CHUNK]) for start in range(0, len(trace), CHUNK)]


@pytest.mark.parametrize("axes", [1, 3])
def test_the_last_seconds_vote_as_if_there_were_no_others(axes):
    stream, trace = make_stream(window=2.5, skip_impact=False), noise(4.05, axes=axes)
    for end in range(CHUNK, trace.shape[1] + CHUNK, CHUNK):
        vote = stream.push({"haptic": trace[:, end - CHUNK : end]})
    expected = stream.classifier.classify(haptic=trace[:, 15_000:40_000])
    assert torch.equal(vote.fragments, expected.fragments)
    torch.testing.assert_close(vote.probabilities, expected.probabilities)
    assert stream.finish() is vote


def test_half_a_second_is_repeated_until_it_fills_a_fragment():
    stream, trace = make_stream(), noise(0.5)
    vote = stream.push({"haptic": trace})
    frames = stream.classifier.sense("haptic").dense_input(trace)  # 46 of 192
    scores = stream.classifier.network(torch.cat([frames] * 5, dim=-1)[..., :192])
    assert scores.shape[-1] == len(vote.fragments) == 1
    torch.testing.assert_close(vote.probabilities, scores[0, :, 0].double().softmax(0))


@settings(max_examples=8)
@given(chunks=st.lists(st.sampled_from([0, 1, 99, 1000, 1601, 7000]), max_size=9))
def test_chunks_do_not_matter(chunks):
    trace = torch.cat((noise(2.0), noise(0.5, 1e-3), noise(1.2)), dim=1)
    stream, whole, place = make_stream(odds=1.1), make_stream(odds=1.1), 0
    expected = whole.push({"haptic": trace})
    for chunk in [*chunks, trace.shape[1]]:
        vote = stream.push({"haptic": trace[:, place : place + chunk]})
        place += chunk
    assert torch.equal(vote.probabilities, expected.probabilities)
    assert stream.changed_at == whole.changed_at


def test_what_is_kept_does_not_grow():
    stream = make_stream(window=1.0)
    for chunk in noise(6.0).split(777, dim=1):
        stream.push({"haptic": chunk})
        kept = [each["haptic"] for each in stream.slices]
        assert sum(each.shape[1] for each in kept) <= RATE
        assert stream.pending["haptic"].untyped_storage().nbytes() < 4 * (CHUNK + 777)
        assert len(stream.labels) <= 7


def test_the_label_follows_within_a_second_and_does_not_wander(surface):
    stream = surface()
    joined = np.concatenate([make_trace(0, 0, 4.0), make_trace(1, 0, 4.0)])
    found = labels(stream, joined)
    said = [each.label for each in found]
    assert said[2:40] == ["alpha"] * 38
    assert said[50:] == ["beta"] * 30
    assert found[39].changed_at is None
    assert 3.8 <= found[-1].changed_at <= 4.5
    assert all(each.contact for each in found)


def test_a_pause_says_so_and_the_vote_begins_anew_behind_the_touch(surface):
    pause = 1e-4 * np.random.default_rng(0).standard_normal(RATE)
    joined = np.concatenate([pause, make_trace(0, 0, 2.0), pause, make_trace(2, 0, 2.0)])
    found = labels(surface(), joined)
    assert [each.contact for each in found] == [False] * 10 + [True] * 22 + [False] * 8 + [
        True
    ] * 20
    assert {each.label for each in found[:15]} == {None}
    assert {each.label for each in found[15:32]} == {"alpha"}
    assert {each.label for each in found[32:45]} == {None}
    assert {each.label for each in found[45:]} == {"gamma"}
    assert (found[20].changed_at, found[-1].changed_at) == (1.0, 4.0)
    assert found[35].fragments == 0


def test_a_stroke_may_turn_round_and_no_level_is_a_pause_where_none_is_known():
    turn = torch.cat((noise(1.0), noise(0.2, 1e-3), noise(1.0)), dim=1)
    stream = make_stream()
    assert stream.push({"haptic": turn}) is not None
    assert (stream.contact, len(stream.slices)) == (True, 20)
    faint = make_stream(contact=0)
    assert faint.push({"haptic": noise(1.0, 1e-3)}) is not None
    assert faint.push({"haptic": torch.full((1, RATE), 9.8)}) is None  # nothing at all


def test_what_prevents_a_vote_is_said_in_the_end():
    stream = make_stream()
    with pytest.raises(UserError, match=r"ended within 0\.3 s"):
        stream.check()
    stream.push({"haptic": noise(1.0, 1e-3)})
    stream.check()  # nothing was touched

    def refuse(*_):
        raise UserError("Too short.")

    stream._sense = refuse
    assert stream.push({"haptic": noise(1.0)}) is None
    with pytest.raises(UserError, match="Too short"):
        stream.check()
