"""No number that a person can type gets past the checks unless it does no harm."""

from dataclasses import fields, is_dataclass
from typing import Any, get_args, get_type_hints

import pytest
from omegaconf import OmegaConf
from omegaconf.errors import ValidationError

from tex_lightning.config import CONF, Config
from tex_lightning.config.check import check_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.errors import UserError

HUGE = 10**30
ABSURD: dict[type, list[Any]] = {
    int: [-5, HUGE, 10**4000, float("nan"), float("inf"), 1e30],
    float: [-5.0, 1e30, float("nan"), float("inf"), -float("inf"), HUGE],
}
# What may be as large as it likes, and why.
HARMLESS = {
    "top_k": "a list is cut to so many",
    "data.classes": "a list is cut to so many, and synthetic data says itself how many there are",
    "crossval.only": "compared with the folds that there are before any work",
}


def numeric_keys(section: type = Config, prefix: str = "") -> list[tuple[str, type, bool]]:
    """Name, type and whether it is a list, of every key that takes numbers, by the annotations."""
    found = []
    hints = get_type_hints(section)
    for each in fields(section):
        kinds = {hints[each.name], *get_args(hints[each.name])}
        inner = {item for kind in kinds for item in get_args(kind)}
        number = next((kind for kind in (int, float) if kind in kinds | inner), None)
        name = f"{prefix}{each.name}"
        if is_dataclass(hints[each.name]):
            found += numeric_keys(hints[each.name], f"{name}.")
        elif number is not None:
            found.append((name, number, any("list" in str(kind) for kind in kinds)))
    return found


@pytest.fixture(scope="module")
def composed():
    return compose_config(CONF)


def refusal(composed, name: str, value: Any) -> str | None:
    """What is said of a value; None if nothing is."""
    config = composed.copy()
    try:
        OmegaConf.update(config, name, value)
        check_config(read_config(config))
    except (UserError, ValidationError) as error:
        return str(error)
    return None


def test_the_defaults_are_in_range(composed):
    check_config(read_config(composed))


def test_there_are_keys_to_check():
    names = {name for name, _, _ in numeric_keys()}
    assert {
        "seed",
        "model.haptic.width",
        "model.visual.head",
        "decision.confidence_thresholds",
    } <= names
    assert len(names) > 80
    assert set(HARMLESS) <= names


@pytest.mark.parametrize(("name", "number", "several"), numeric_keys(), ids=lambda item: str(item))
def test_absurd_numbers_are_refused(composed, name, number, several):
    for absurd in ABSURD[number]:
        said = refusal(composed, name, [absurd, absurd] if several else absurd)
        if said is None:
            assert name in HARMLESS, f"{name}={absurd} passes"
            assert absurd in (HUGE, 10**4000) or name == "crossval.only"
        else:
            assert len(said) < 1000
