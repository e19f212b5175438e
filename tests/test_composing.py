"""What the tests keep of Hydra's compositions is what Hydra composes."""

import pytest
from omegaconf import OmegaConf

from tex_lightning.config.composition import compose_config

ASKED = [
    ["model=haptic", "model.haptic.width=0.3", "seed=3"],
    ["experiment=few/haptic", "callbacks={}", "+data.reader.fold=2", "~decision"],
    ["model=haptic", "model.hapitc.width=0.3"],
]


def outcome(overrides: list[str]) -> object:
    try:
        return compose_config(overrides)
    except Exception as error:
        return type(error), str(error)


@pytest.mark.parametrize("overrides", ASKED, ids=str)
def test_a_kept_composition_is_a_new_one(overrides, monkeypatch):
    first, second = outcome(overrides), outcome(overrides)
    monkeypatch.setattr("composing.OWN", set())
    assert first == second == outcome(overrides)


def test_what_one_test_changes_the_next_does_not_get():
    changed = compose_config(["model=haptic"])
    changed.model.haptic.width = 0.01
    assert compose_config(["model=haptic"]).model.haptic.width != 0.01


def test_a_file_is_read_once(monkeypatch):
    compose_config(["model=haptic"])
    monkeypatch.setattr(OmegaConf, "load", None)
    compose_config(["model=haptic", "seed=1"])
