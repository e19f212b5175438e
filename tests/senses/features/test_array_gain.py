"""The pattern of an array tells its gain; how hard it is pressed is left as it is."""

import re

import numpy as np
import pytest
import torch

from tex_lightning.core.console import Screen
from tex_lightning.export.signals import ProportionsGraph
from tex_lightning.senses.features.array_gain import ArrayGain
from tex_lightning.senses.features.proportions import BandProportions

GROWTH = np.array([0.6, 1.0, 1.4, 0.8, 1.3])  # outer channels of an array are touched later


def pressures(strength: float, seed: int = 0, growth: np.ndarray = GROWTH) -> torch.Tensor:
    """Pressures (5, 400) of a material that is pressed so hard."""
    rng = np.random.default_rng(seed)
    means = strength**growth * np.exp(0.02 * rng.standard_normal(len(growth)))
    return torch.from_numpy(means[:, None] * (1 + 0.1 * rng.random((len(growth), 400)))).float()


def training(growth: np.ndarray = GROWTH) -> list[torch.Tensor]:
    strengths = np.random.default_rng(1).uniform(1, 3, 40)
    return [pressures(strength, 100 + n, growth) for n, strength in enumerate(strengths)]


def fitted(*recordings: torch.Tensor) -> ArrayGain:
    array = ArrayGain(len(recordings[0]))
    means = torch.stack([recording.mean(dim=-1) for recording in recordings])
    array.fit(means, (means > 0).all(dim=0))
    return array


@pytest.fixture(scope="module")
def array() -> ArrayGain:
    return fitted(*training())


@pytest.mark.parametrize("gain", [0.01, 0.5, 1.5, 1000.0])
@pytest.mark.parametrize("strength", [1.2, 2.8])
def test_another_gain_is_that_of_the_training(array, gain, strength):
    trace = pressures(strength)
    found = array(gain * trace)
    torch.testing.assert_close(found, trace, rtol=0.15, atol=0)
    assert array(found).equal(found)
    torch.testing.assert_close(gain * trace * array.gain(gain * trace), found)


def test_it_is_told_once(array, caplog, monkeypatch):
    monkeypatch.setattr(Screen, "logged", set())
    with caplog.at_level("INFO"):
        for seed in (20, 21):
            array(2 * pressures(2, seed))
    (told,) = caplog.messages
    assert re.match(r"The channels are (1\.9|2)\d* times as strong as their pattern tells", told)


def test_what_was_recorded_as_the_training_was_stays_however_hard_it_is_pressed(array):
    for seed, strength in enumerate(np.linspace(0.5, 6, 40)):
        trace = pressures(strength, seed)
        assert array(trace).equal(trace)


def test_what_changes_within_a_recording_or_has_an_odd_pattern_is_left(array):
    trace = pressures(2)
    changing = trace * torch.linspace(1, 4, 400).log()
    odd = 3 * trace * torch.tensor([0.1, 1, 10, 1, 1])[:, None]
    for left in (changing, odd, trace[:, :1]):
        assert array(left).equal(left)


@pytest.mark.parametrize(
    "recordings",
    [
        [trace[:3] for trace in training()],  # axes
        [trace - 2 for trace in training()],  # of either sign
        training()[:19],
        training(np.ones(5)),  # a pattern that tells no strength
    ],
)
def test_without_a_pattern_that_tells_the_strength_nothing_changes(recordings):
    array = fitted(*recordings)
    assert not array.in_use
    other = 3 * recordings[0]
    assert array(other) is other
    assert array.gain(other) == 1


def test_it_is_loaded_with_a_checkpoint_and_older_ones_have_none(array):
    loaded, older = ArrayGain(5), ArrayGain(5)
    loaded.load_state_dict(array.state_dict())
    assert loaded(3 * pressures(2)).equal(array(3 * pressures(2)))
    older.load_state_dict({})
    assert not older.in_use


@pytest.mark.parametrize("skip_impact", [False, True])
def test_proportions_in_python_in_a_stream_and_exported_are_at_the_usual_gain(skip_impact):
    features = BandProportions(
        sampling_rate=100, windows=[0.3], bands_per_octave=[4], thresholds=3, fragment_seconds=2,
        skip_impact=skip_impact, levels=5,
    )  # fmt: skip
    features.learn(training())
    assert features.array.in_use
    trace = pressures(2)
    other = 3 * trace
    factor = features.gain(other)
    torch.testing.assert_close(factor, torch.tensor(1 / 3), rtol=0.15, atol=0)
    torch.testing.assert_close(features(other), features(other * factor))
    found = ProportionsGraph(features)(other)
    torch.testing.assert_close(found, features(other), rtol=0, atol=1e-4)
