"""Gravity tells the gain of an accelerometer; what else changes is left as it is."""

import re

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tex_lightning.core.console import Screen
from tex_lightning.senses.features.gravity import GravityGain

G = 9.80665


def accelerations(turned: int = 0, gain: float = G, other: float = 1.0) -> torch.Tensor:
    """Accelerations and angular velocities (6, 400) of a sensor that is held in some direction."""
    rng = np.random.default_rng(turned)
    gravity = Rotation.random(random_state=turned).apply([0, 0, 1.0])
    both = np.concatenate(
        (gravity[:, None] + 0.1 * rng.standard_normal((3, 400)), np.zeros((3, 400)))
    )
    both[3:] = rng.standard_normal((3, 400)) + 0.3 * rng.standard_normal((3, 1))
    return torch.from_numpy(both * np.repeat([gain, other], 3)[:, None]).float()


def fitted(*recordings: torch.Tensor, positive: bool = False) -> GravityGain:
    gravity = GravityGain(len(recordings[0]))
    means = torch.stack([recording.mean(dim=-1) for recording in recordings])
    gravity.fit(means, torch.full((len(recordings[0]),), positive))
    return gravity


@pytest.fixture
def gravity() -> GravityGain:
    return fitted(*map(accelerations, range(8)))


@pytest.mark.parametrize("gain", [1.0, 0.5 * G, 2 * G, 1000.0])
def test_another_unit_is_that_of_the_training_and_other_channels_stay(gravity, gain):
    found = gravity(accelerations(20, gain, other=7.0))
    expected = accelerations(20, G, other=7.0)
    torch.testing.assert_close(found[:3], expected[:3], rtol=0.01, atol=0)
    assert found[3:].equal(expected[3:])
    again = gravity(found)
    assert again.equal(found)


def test_it_is_told_once(gravity, caplog, monkeypatch):
    monkeypatch.setattr(Screen, "logged", set())
    with caplog.at_level("INFO"):
        for turned in (20, 21):
            gravity(accelerations(turned, gain=1.0))
    (told,) = caplog.messages
    assert re.match(r"Gravity, the mean of channels 0 to 2, is [01]\.\d+ and was 9\.8", told)


def test_what_was_recorded_as_the_training_was_stays_whatever_its_direction(gravity):
    for turned in range(30, 40):
        assert gravity(accelerations(turned)).equal(accelerations(turned))


def test_what_changes_within_a_recording_is_no_gain(gravity):
    drifting = accelerations(20) + torch.linspace(0, 60, 400)
    assert gravity(drifting).equal(drifting)
    assert gravity(drifting[:, :1]).equal(drifting[:, :1])  # too short to have halves


@pytest.mark.parametrize(
    "without",
    [
        lambda: fitted(*(accelerations(turned, gain=turned + 1) for turned in range(8))),
        lambda: fitted(*map(accelerations, range(4))),
        lambda: fitted(*(accelerations(turned)[3:] for turned in range(8))),
        lambda: fitted(*map(accelerations, range(8)), positive=True),
        lambda: fitted(*(accelerations(turned)[:2] for turned in range(8))),
    ],
    ids=["norms differ", "too few", "no accelerations", "pressures", "two channels"],
)
def test_without_a_gravity_that_is_always_the_same_nothing_changes(without):
    gravity = without()
    assert not gravity.in_use
    other = accelerations(20, 1.0)[: 6 if gravity.shapes["norms"] == (2,) else 3]
    assert gravity(other) is other


def test_it_is_loaded_with_a_checkpoint_and_older_ones_have_none(gravity):
    loaded = GravityGain(6)
    loaded.load_state_dict(gravity.state_dict())
    assert loaded.norms[0] == pytest.approx(G, rel=0.01)
    assert loaded.norms[1] == 0
    loaded.load_state_dict({})
    assert not loaded.in_use
