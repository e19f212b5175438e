"""Where a tool moves: the touch that begins a stroke, and rests between and after strokes."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.senses.features.movement import block_length, movement_start, moving


def noise(seconds: float, axes: int = 1, seed: int = 0, rate: int = 10_000) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(axes, int(seconds * rate), generator=generator)


def test_skips_the_touch_but_no_movement():
    quiet, movement = 0.001 * noise(0.5), 0.3 * noise(3.0, seed=1)
    touch = torch.zeros(1, 500)
    touch[0, 0] = 5.0
    start = movement_start(torch.cat((quiet, touch, movement), dim=1), 10_000)
    assert start == 5000 + 2000
    assert movement_start(movement, 10_000) == 0


def test_a_touch_is_the_same_as_soon_as_the_movement_after_it_is_known():
    trace = torch.cat((0.001 * noise(1.5), 0.3 * noise(3.0, seed=1)), dim=1)
    starts = [movement_start(trace[:, :end], 10_000) for end in range(14_000, 45_000, 500)]
    assert sorted(set(starts)) == [0, 17_000]
    assert starts == sorted(starts)
    assert movement_start(trace[:, :18_010], 10_000) == 17_000


def test_gravity_does_not_hide_the_touch():
    trace = torch.cat((0.001 * noise(0.5, 3), 0.5 * noise(2.0, 3)), dim=1)
    trace += torch.tensor([[0.1], [0.99], [0.0]])
    assert 7000 <= movement_start(trace, 10_000) <= 7010


@pytest.mark.parametrize("rest", [0.0, 0.01])  # silence, and the noise of a sensor
@pytest.mark.parametrize("rate", [50, 100, 1000, 10_000])
def test_rests_between_and_after_strokes_are_left_out(rest, rate):
    pause = 9.81 + rest * noise(2, seed=1, rate=rate)
    strokes = [9.81 + noise(1, seed=seed, rate=rate) for seed in (2, 3)]
    trace = torch.cat((strokes[0], pause, strokes[1], pause, strokes[0], pause), dim=1)
    found = moving(trace, rate)
    spare = 2 * block_length(rate)  # of blocks that hold some of both
    assert abs(found.shape[1] - 3 * rate) <= 3 * spare
    assert (found - 9.81).abs().mean() > 0.7  # nearly nothing but movement
    whole = moving(trace, rate, pieces=False)  # a sample's number still tells its time
    begin = movement_start(trace, rate)
    assert torch.equal(whole, trace[:, begin : begin + whole.shape[1]])
    assert begin == 0
    assert abs(whole.shape[1] - 7 * rate) <= spare


@given(factor=st.floats(0.1, 1.0), seconds=st.floats(0.05, 0.3), seed=st.integers(0, 20))
def test_movement_that_varies_or_turns_for_a_moment_is_kept_whole(factor, seconds, seed):
    trace, middle = noise(3, axes=3, seed=seed, rate=2000), 3000
    trace[:, 1000:2000] *= factor
    trace[:, middle : middle + int(2000 * seconds)] = 0.0
    assert torch.equal(moving(trace, 2000.0), trace)


def test_nothing_is_cut_from_short_and_constant_signals():
    for trace in (noise(0.01), torch.full((1, 9000), 3.0)):
        assert torch.equal(moving(trace, 10_000.0), trace)


@pytest.mark.parametrize(("number", "cut"), [(1, True), (2, True), (4, False)])
@pytest.mark.parametrize("rest", [0.0, 4.0])
def test_knocks_are_left_out_unless_they_recur(number, cut, rest):
    """Of strokes of 5 s, whatever rest follows; a block in forty may be a knock."""
    stroke, samples = noise(5, rate=2000), torch.arange(100)
    for place in range(number):
        begin = 1000 + 1500 * place  # the first sample of a block
        stroke[:, begin : begin + 100] += 40 * torch.exp(-samples / 20) * torch.cos(samples)
    trace = torch.cat((stroke, 1e-3 * noise(rest, rate=2000, seed=1)), dim=1)
    found = moving(trace, 2000)
    assert abs(found.shape[1] - (10_000 - 300 * number * cut)) <= 100 * (rest > 0)
    assert (found.abs().max() < 6) == cut


def test_a_louder_stroke_between_rests_is_no_knock():
    rests = [0.02 * noise(10, seed=seed, rate=2000) for seed in (1, 2)]
    trace = torch.cat((rests[0], noise(1, seed=3, rate=2000), rests[1]), dim=1)
    assert moving(trace, 2000).abs().max() == trace.abs().max()


@pytest.mark.parametrize("rate", [100.0, 2000.0])
def test_a_tool_that_is_picked_up_belongs_to_the_rest_and_taps_do_not(rate):
    rng, length = np.random.default_rng(0), round(2 * rate)
    quiet, stroke = 1e-3 * rng.standard_normal(length), rng.standard_normal(length)
    lying, moved = 60 + quiet, np.linspace(60, 0, round(0.2 * rate))
    lifted = torch.from_numpy(np.concatenate((lying, moved, stroke, moved[::-1], lying)))
    kept = moving(lifted[None].float(), rate)
    assert abs(kept.shape[1] - length) <= 0.3 * rate
    assert kept.mean().abs() < 0.5
    tap = np.concatenate((quiet[: round(0.6 * rate)], stroke[: round(0.2 * rate)]))
    taps = torch.from_numpy(np.tile(tap, 8))[None].float()
    assert moving(taps, rate).shape[1] >= 0.2 * rate * 7
