"""Proportions of bands: filters, what counts and what does not, fragments, wrong input."""

import copy
import weakref
from collections.abc import Sequence

import numpy as np
import pytest
import torch
from omegaconf import OmegaConf
from scipy.signal import resample_poly

from tex_lightning.config import CONF
from tex_lightning.errors import UserError
from tex_lightning.senses.features import octave_bands, proportions
from tex_lightning.senses.features.proportions import BandProportions

WINDOWS = (0.032, 0.256)


def make(rate: float = 2000.0, **changes) -> BandProportions:
    settings = {
        "windows": WINDOWS,
        "bands_per_octave": (4, 4),
        "thresholds": 8,
        "fragment_seconds": 0.5,
        "skip_impact": False,
    }
    return BandProportions(sampling_rate=rate, **{**settings, **changes})


def noise(seconds: float, rate: float = 2000.0, seed: int = 0, axes: int = 1) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(axes, round(seconds * rate), generator=generator)


def of_kind(features: BandProportions, *kinds: str) -> torch.Tensor:
    """Which features (D,) belong to blocks of the kinds."""
    return torch.tensor([kind in kinds for kind, size in features.blocks for _ in range(size)])


def test_half_of_the_frames_stand_above_the_middle_of_an_even_number_of_thresholds():
    features, traces = make(), [noise(4, seed=seed) for seed in range(6)]
    features.learn(traces)
    shares = torch.cat([features(trace)[0, 0] for trace in traces], dim=1)
    shares = shares[of_kind(features, "shape")]
    by_threshold = shares.reshape(-1, 8, shares.shape[1]).mean(dim=(0, 2))
    expected = 1 - (torch.arange(8) + 0.5) / 8
    torch.testing.assert_close(by_threshold, expected, atol=0.03, rtol=0)


def test_rounding_changes_no_proportion_of_a_training_recording():
    features, trace = make(thresholds=6), noise(2)
    features.learn([trace])  # every threshold comes from this recording
    others = (trace * 1.001, trace.double().mul(0.999).float())
    for other in others:
        torch.testing.assert_close(features(other), features(trace), atol=1e-3, rtol=1e-3)


def test_blocks_name_all_features_in_their_order():
    features = make(levels=2)
    features.learn([noise(4, axes=2)])
    kinds = [kind for kind, _ in features.blocks]
    axes = [*["axes"] * 3, "axes_power"]
    window = [*["shape"] * 3, "power", *axes, *["mean"] * 2, "deviation"]
    assert kinds == window * 2 + ["level"] * 2
    assert sum(size for _, size in features.blocks) == features.bands
    assert features(noise(4, axes=2)).shape[2] == features.bands


def test_means_and_deviations_are_those_of_the_frames():
    features, trace = make(levels=2, fragment_seconds=9), noise(3, axes=2)
    features.learn([trace])
    output, window = features(trace)[0, 0, :, 0], features.windows[0]
    responses, bands = window.responses(trace, features.level).numpy(), window.sizes[0]
    means, deviations = of_kind(features, "mean"), of_kind(features, "deviation")
    expected = responses[:, : 2 * bands - 1]
    np.testing.assert_allclose(output[means][: 2 * bands - 1], expected.mean(axis=0), atol=1e-5)
    together = responses[:, : 4 * bands - 1]
    np.testing.assert_allclose(output[deviations][: 4 * bands - 1], together.std(axis=0), atol=1e-4)


def test_an_axis_by_itself_is_compared_as_the_only_one_of_a_signal():
    both, single = make(levels=2), make()
    trace = noise(3, axes=2)
    both.learn([trace])
    single.windows[0].detrends = True  # as those of accelerations
    single.level.copy_(both.level)
    bands = single.windows[0].sizes[0]
    every = both.windows[0].responses(trace, both.level)
    apart = every[:, 4 * bands - 1 :]  # four comparisons where levels count
    relative = apart[:, : 2 * bands].reshape(-1, 2, bands)
    for axis in range(2):
        expected = single.windows[0].responses(trace[axis : axis + 1], single.level)[:, :bands]
        torch.testing.assert_close(relative[:, axis], expected)
    assert apart.shape[1] == 2 * (4 * bands - 1)


def test_neither_strength_nor_offset_nor_polarity_counts():
    features = make()
    features.learn([noise(4), noise(4, seed=1)])
    trace = noise(3, seed=2)
    for other in (5 * trace, 1e-3 * trace, trace + 9.81, -trace):
        assert (features(other) - features(trace)).abs().mean() < 1e-3
    slow = make(levels=1)
    slow.learn([noise(4), noise(4, seed=1)])
    power = of_kind(slow, "power")
    assert (slow(5 * trace) - slow(trace))[:, :, power].mean() > 0.1  # louder


@pytest.mark.parametrize("levels", [None, 1])
def test_a_tool_that_tilts_changes_little_and_the_trend_of_a_pressure_counts(levels):
    traces = [noise(4, seed=seed).cumsum(dim=1) / 5 + noise(4, seed=9 + seed) for seed in range(3)]
    tilt = 10 * torch.sin(torch.arange(8000) / 1500)  # 0.2 Hz
    changes = {}
    for offset in (0, 1000):
        features = make(levels=levels)
        features.learn([trace + offset for trace in traces])
        change = features(traces[0] + offset + tilt) - features(traces[0] + offset)
        changes[offset] = float(change[0, 0, of_kind(features, "shape")].abs().mean())
    assert changes[0] < 0.03
    assert changes[1000] > (2 * changes[0] if levels else 0)
    older = make(levels=levels)  # of a checkpoint of before
    older.load_state_dict({k: v for k, v in features.state_dict().items() if k != "detrends"})
    assert not older.windows[0].detrends
    older.load_state_dict(features.state_dict())
    assert older.windows[0].detrends == (levels is None)


@pytest.mark.parametrize("sign", [1, -1])
def test_levels_are_logarithms_where_all_training_samples_are_positive(sign):
    features = make(levels=3, rate=100.0, fragment_seconds=4)
    offset = torch.tensor([9.81, sign * 7.0, 5.0])[:, None]
    features.learn([offset + 0.5 * noise(5, 100.0, seed, axes=3) for seed in range(4)])
    trace = offset + 0.5 * noise(4, 100.0, 9, axes=3)
    level = features(trace)[0, 0, -6:-3, 0]
    mean = trace.mean(dim=1)
    signed = mean[1].log() if sign > 0 else mean[1] / features.deviation[1]
    expected = torch.stack([mean[0].log(), signed, mean[2].log()])
    torch.testing.assert_close(level, expected)
    with pytest.raises(UserError, match="has 1 channels, and this network was trained on 3"):
        features(trace[:1])


def test_levels_do_not_depend_on_the_unit_but_of_older_checkpoints():
    features, other = make(levels=2, rate=100.0), make(levels=2, rate=100.0)
    traces = [noise(5, 100.0, seed, axes=2) for seed in range(4)]
    features.learn(traces)
    other.learn([1e-6 * trace for trace in traces])
    torch.testing.assert_close(other(1e-6 * traces[0]), features(traces[0]), rtol=0, atol=1e-4)
    older = make(levels=2, rate=100.0)
    older.load_state_dict({k: v for k, v in features.state_dict().items() if k != "unit"})
    means = older(traces[0])[0, 0, -4:-2].mean(dim=1)
    torch.testing.assert_close(means, traces[0].mean(dim=1))
    older = copy.deepcopy(features)
    del older.unit  # as in a pickle of an estimator
    means = copy.deepcopy(older)(traces[0])[0, 0, -4:-2].mean(dim=1)
    torch.testing.assert_close(means, traces[0].mean(dim=1))


def test_windows_follow_from_rate_and_length():
    slow = make(rate=36.0, windows=(0.032, 0.256, 0.93), bands_per_octave=(6, 6, 12))
    assert [window.length for window in slow.windows] == [9, 33]  # 0.032 s would be one sample
    slow.learn([noise(4, 36.0)])
    assert slow.used == [*slow.windows]
    slow.learn([noise(1.5, 36.0)] * 2 + [noise(4, 36.0)])  # the usual one is shorter
    assert slow.used == [slow.windows[0]]
    slow.learn([noise(1.5, 36.0)] + [noise(4, 36.0)] * 2)
    assert slow.used == [*slow.windows]
    assert slow(noise(0.5, 36.0)).shape[2] == slow.bands
    level = make(rate=36.0, windows=(0.256, 0.93), bands_per_octave=(6, 12), levels=1)
    level.learn([noise(3.5, 36.0)])  # twice 0.93 s fit, and of a slow signal it takes four times
    assert level.used == [level.windows[0]]
    fast = make(rate=10_000.0, windows=(0.256, 0.93))
    assert [window.length for window in fast.windows] == [4 * 640, 16 * 588]


@pytest.mark.parametrize(
    ("rate", "count"), [(20.0, 2), (50.0, 3), (2200.0, 4), (44_100.0, 3), (200_000.0, 2)]
)
def test_the_windows_of_the_presets_are_those_that_any_rate_has_memory_for(rate, count):
    sense = OmegaConf.load(CONF / "sense" / "band_proportions.yaml")
    settings = {**sense.features, "skip_impact": sense.skip_impact}
    del settings["_target_"]
    features = BandProportions(sampling_rate=rate, **settings)
    assert len(features.windows) == count
    assert max(window.length for window in features.windows) <= 65_536
    recording = noise(5.6, rate)
    features.learn([recording])
    assert features.used == [*features.windows]
    assert features(recording).shape[2] == features.bands


def test_a_short_recording_is_mirrored_until_the_longest_window_fits():
    features, trace = make(), noise(0.2, seed=1)
    features.learn([noise(4)])
    assert features.longest is features.windows[1]  # of 0.256 s
    mirrored = torch.cat((trace, trace.flip(-1), trace), dim=1)[:, : features.longest.length]
    torch.testing.assert_close(features(trace), features(mirrored))


def test_bins_are_the_bands_that_a_tone_changes():
    features = make(windows=(0.064,), bands_per_octave=(4,))
    features.learn([noise(4, seed=seed) for seed in range(4)])
    tone = 3 * torch.sin(2 * torch.pi * 250 * torch.arange(8000) / 2000)
    changed = (features(noise(4) + tone) - features(noise(4))).abs().mean(dim=3)[0, 0]
    bins = torch.tensor(features.bins)
    by_bin = torch.stack([changed[bins == number].mean() for number in range(int(bins.max()) + 1)])
    channel = (torch.arange(65) == 16).float()  # of 15.6 Hz
    loudest = features.windows[0].filters.T @ channel
    assert int(by_bin.argmax()) == int(loudest.argmax())
    assert make(levels=1).bins == [-1] * make(levels=1).bands


def test_three_axes_count_by_their_power_whichever_way_the_tool_is_turned():
    features, trace = make(), noise(3, axes=3)
    features.learn([trace])
    turn, _ = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(1)))
    assert (features(turn @ trace) - features(trace)).abs().mean() < 1e-2
    assert (features(trace.flip(-1)) - features(trace)).abs().mean() > 2e-2


@pytest.mark.parametrize("levels", [None, 2])
@pytest.mark.parametrize("fragment_seconds", [0.05, 0.5, 7])
def test_the_size_of_blocks_changes_nothing(levels, fragment_seconds, monkeypatch):
    traces = [noise(4, 300.0, seed, axes=2) for seed in range(3)]
    found = []
    for most in (7, 10_000):
        monkeypatch.setattr(octave_bands, "MIN_BLOCK", most)
        for module in (octave_bands, proportions):
            monkeypatch.setattr(module, "MAX_BLOCK", most)
        features = make(300.0, levels=levels, fragment_seconds=fragment_seconds)
        features.learn(traces)
        found.append(
            (features.windows[1].thresholds, features(noise(5, 300.0, 5, axes=2).cumsum(dim=1)))
        )
    torch.testing.assert_close(*found, atol=1e-4, rtol=1e-4)


def test_few_recordings_are_held_and_no_more_than_enough_are_read(monkeypatch):
    monkeypatch.setattr(proportions, "MAX_HELD", 2 * 4000)  # two recordings
    held, most, seen = weakref.WeakSet(), 0, set()

    class Recordings(Sequence):
        def __init__(self, seeds):
            self.seeds = seeds

        def __len__(self):
            return len(self.seeds)

        def __getitem__(self, place):
            nonlocal most
            if isinstance(place, slice):
                return Recordings(self.seeds[place])
            seen.add(self.seeds[place])
            trace = noise(2, seed=self.seeds[place])
            held.add(trace)
            most = max(most, len(held))
            return trace

    read, listed = make(), make()
    read.learn(Recordings(range(6)))
    assert most <= 5  # the held ones, two in use, and one that is read
    assert seen == {*range(6)}
    monkeypatch.setattr(proportions, "MAX_HELD", 6 * 4000)
    listed.learn([noise(2, seed=seed) for seed in range(6)])
    torch.testing.assert_close(
        read.windows[0].thresholds, listed.windows[0].thresholds, rtol=0, atol=0
    )
    monkeypatch.setattr(proportions, "MAX_RECORDINGS", 3)
    seen.clear()
    read.learn(Recordings(range(6)))
    assert seen == {0, 2, 4}


@pytest.mark.parametrize(("seconds", "fragments"), [(0.26, 1), (1.2, 2), (5.0, 10)])
def test_fragments_are_about_half_seconds(seconds, fragments):
    features = make()
    features.learn([noise(5)])
    trace = noise(seconds, seed=3)
    shares = features(trace)
    assert shares.shape == (1, 1, features.bands, fragments)
    shares = shares[:, :, of_kind(features, "shape")]
    assert 0 <= shares.min() <= shares.max() <= 1 + 1e-6


def test_rows_of_a_fragment_are_the_frames_inside_of_it():
    features = make()
    quiet, loud = noise(2), torch.sin(2 * torch.pi * 300 * torch.arange(4000) / 2000)[None]
    features.learn([quiet, loud])
    shares = of_kind(features, "shape")
    both = features(torch.cat((quiet, loud), dim=1))[0, 0, shares]
    alone = features(quiet)[0, 0, shares]
    torch.testing.assert_close(both[:, :3], alone[:, :3], atol=0.35, rtol=0)
    assert (both[:, 0] - both[:, -1]).abs().max() == 1


def test_bands_that_are_empty_at_a_lower_rate_change_no_others():
    """Of what was recorded at half the rate, as SciPy resamples it back."""
    features = make()
    traces = [noise(4.0, seed=n).cumsum(dim=1) + 3 * noise(4.0, seed=9 + n) for n in range(3)]
    features.learn(traces)
    halved = resample_poly(traces[0].double().numpy(), 1, 2, axis=1)
    lower = torch.from_numpy(resample_poly(halved, 2, 1, axis=1)).float()
    state = features.state_dict()
    older = make()  # of a checkpoint of before: no band is taken for empty
    known = {name: x for name, x in state.items() if "usual" not in name}
    for number in range(2):
        known[f"thresholds{number}"] = known.pop(f"windows.{number}.thresholds")
    older.load_state_dict(known)
    torch.testing.assert_close(older(traces[0]), features(traces[0]))
    for index, window in enumerate(features.used):
        low = slice(0, window.sizes[0] - 2 * 4)  # not the octave above, nor the edge
        moved, before = (
            window.responses(lower, features.level) - window.responses(traces[0], features.level)
            for window in (features.windows[index], older.windows[index])
        )
        moved, before = (x[:, low].abs().mean() for x in (moved, before))
        assert moved < before / 2
        assert before > 0.3
    again = make()
    again.load_state_dict(state)
    assert torch.equal(again(lower), features(lower))
    for number, window in enumerate(features.windows):  # as a checkpoint has it that is less old
        mean, deviation = state.pop(f"windows.{number}.usual.moments")[:, : window.sizes[0]]
        state[f"windows.{number}.usual"] = torch.stack([mean, (4 * deviation).clamp_min(2)])
    again = make()
    again.load_state_dict(state)
    torch.testing.assert_close(again(lower), features(lower))


@pytest.mark.parametrize("levels", [None, 2])
def test_what_is_empty_counts_as_it_usually_is(levels):
    """Of noise, whose bands do not depend on each other, recorded at half the rate."""
    traces = [noise(6.0, seed=seed, axes=2) for seed in range(4)]
    features, unaware = make(levels=levels), make(levels=levels)
    for each in (features, unaware):
        each.learn(traces)
    for window in unaware.windows:
        window.usual.forget()
    halved = resample_poly(traces[0].double().numpy(), 1, 2, axis=1)
    lower = torch.from_numpy(resample_poly(halved, 2, 1, axis=1)).float()
    differences = {}
    for read in (features, unaware):
        change = (read(lower) - features(traces[0]))[0, 0].mean(dim=1)
        for kind in ("shape", "mean", *(("power", "deviation", "axes") if levels else ())):
            chosen = of_kind(features, kind)
            differences.setdefault(kind, []).append(float(change[chosen].abs().mean()))
    for kind, (known, unknown) in differences.items():
        assert known < 0.65 * unknown, (kind, known, unknown)


@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_what_is_shorter_than_every_window_of_a_slow_signal_is_mirrored(rate):
    features = make(rate, windows=(0.256, 0.93), skip_impact=True, levels=1)
    features.learn([noise(9, rate, seed) for seed in range(3)])
    short = noise(0.4, rate, seed=3)[:, : features.min_samples]
    assert short.shape[1] < min(window.length for window in features.windows)
    twice = torch.cat((short, short.flip(1)), dim=1)
    torch.testing.assert_close(features(short)[0, 0, :, 0], features(twice)[0, 0, :, 0])


def test_what_is_too_short_is_refused_with_its_length():
    features = make()
    with pytest.raises(UserError, match=r"0\.03 s of movement, less than 0\.032 s; rec"):
        features(noise(0.03))
    for seconds in (0.001, 60.0):  # 2 samples; 120,000
        with pytest.raises(UserError, match="No window of 8 to 65536 samples at 2000 Hz"):
            make(windows=(seconds,), bands_per_octave=(4,))
