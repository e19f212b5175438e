"""Whatever a key is given, it is taken or refused in one sentence."""

import inspect
import itertools
import math
import pickle
from dataclasses import is_dataclass
from typing import Any, get_args, get_type_hints

import pytest
from omegaconf import OmegaConf

from tex_lightning.config import Config, flatten
from tex_lightning.config.check import check_config, read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.mistakes import MISTAKES, explain
from tex_lightning.errors import UserError
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.trunks import Trunk
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

HUGE = 10**30
ABSURD: dict[type, list[Any]] = {
    int: [-5, HUGE, 10**4000],
    float: [-5.0, 1e30, float("nan")],
}
# What may be as large as it likes, and why.
HARMLESS = {
    "top_k": "a list is cut to so many",
    "data.classes": "a list is cut to so many, and synthetic data says itself how many there are",
    "crossval.only": "compared with the folds that there are before any work",
}


PHOTO = inspect.signature(VisualNet), inspect.signature(Trunk)
SIGNAL = inspect.signature(HapticNet), inspect.signature(SpectrogramFeatures)
TAKEN = {"model.haptic.": SIGNAL, "model.sound.": SIGNAL, "model.visual.": PHOTO}
OFFERED = ("classes", "sampling_rate")  # by the sense


def numeric_keys(section: type = Config, prefix: str = "") -> list[tuple[str, type, bool]]:
    """Name, type and whether it is a list, of every key that takes numbers, by the annotations."""
    found = []
    hints = get_type_hints(section)
    for signature in TAKEN.get(prefix, ()):
        taken = signature.parameters.items()
        hints |= {name: each.annotation for name, each in taken if name not in OFFERED}
    for key in hints:
        kinds = {hints[key], *get_args(hints[key])}
        inner = {item for kind in kinds for item in get_args(kind)}
        number = next((kind for kind in (int, float) if kind in kinds | inner), None)
        name = f"{prefix}{key}"
        if is_dataclass(hints[key]):
            found += numeric_keys(hints[key], f"{name}.")
        elif number is not None:
            found.append((name, number, "Sequence" in str(kinds) or "list" in str(kinds)))
    return sorted(found, key=str)


@pytest.fixture(scope="module")
def composed():
    return compose_config()


def refusal(composed, name: str, value: Any) -> str | None:
    """What the command line says of a value; None if nothing is."""
    config = pickle.loads(pickle.dumps(composed))  # in a fifth of the time of a copy
    try:
        OmegaConf.update(config, name, value)
        check_config(read_config(config))
    except UserError as error:
        return str(error)
    except MISTAKES as error:
        return str(explain(error))
    return None


def test_the_defaults_are_in_range_and_there_are_keys_to_check(composed):
    check_config(read_config(composed))
    names = {name for name, _, _ in numeric_keys()}
    assert {"seed", "model.haptic.width", "model.visual.head", *HARMLESS} <= names
    assert len(names) > 80


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e30, 2.5])
def test_where_a_whole_number_belongs_no_other_is_taken(composed, value):
    for name in ("seed", "data.folds", "model.haptic.fit.epochs", "model.visual.head"):
        assert refusal(composed, name, [value, value] if "head" in name else value)


@pytest.mark.parametrize(("name", "number", "several"), numeric_keys(), ids=lambda item: str(item))
def test_absurd_numbers_are_refused(composed, name, number, several):
    for absurd in ABSURD[number]:
        said = refusal(composed, name, [absurd, absurd] if several else absurd)
        if said is None:
            assert name in HARMLESS, f"{name}={absurd} passes"
            assert absurd in (HUGE, 10**4000) or name == "crossval.only"
        else:
            assert len(said) < 1000


VALUES = ["abc", -1, 0, math.nan, math.inf, 1e300, 10**30, "", [], {}, [1], ["a"], {"a": 1}]
VALUES += [None, True, [[1]], "a\nb", "\x00", "x" * 10_000, "/", "/dev/null", "???", -0.5, [None]]


@pytest.mark.slow
def test_every_key_takes_or_refuses_every_value():
    composed, said = compose_config(["model=fusion"]), {}
    keys = sorted(flatten(OmegaConf.to_container(composed, resolve=False)))
    for key, value in itertools.product(keys, VALUES):
        said[key, repr(value)[:50]] = refusal(composed, key, value)
    texts = list(filter(None, said.values()))
    assert [text for text in texts if len(text) > 900] == []
    assert len(said) > len(texts) > len(said) / 2
