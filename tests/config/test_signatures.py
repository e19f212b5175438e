"""Values are compared with the annotated signature of what takes them."""

import json
import math
import random
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import Annotated, Any, Literal

import pytest
import torch
from lightning.pytorch.callbacks import ModelCheckpoint
from lightning.pytorch.loggers import CSVLogger, TensorBoardLogger
from omegaconf import BooleanNode, OmegaConf

from tex_lightning.cli import run_task
from tex_lightning.config import Job, flatten
from tex_lightning.config.composition import compose_config
from tex_lightning.config.instantiation import build
from tex_lightning.config.mistakes import to_user_error
from tex_lightning.config.signatures import converted, misfits, signature_of
from tex_lightning.data.decode import PhotoDecoder, SignalDecoder
from tex_lightning.errors import UserError


@dataclass
class Reader:
    root: str
    rate: float = 10.0
    day: str | None = None
    days: list[str] | None = None
    number: Annotated[int, "[1, 64]"] = 1
    swapped: bool = False

    def read(self) -> None: ...


def wanted(called: Any, **values: Any) -> dict[str, str]:
    """What is asked for in place of each value that does not fit."""
    said = [text.partition(" is ") for text in misfits("k", called, values)]
    return {name.removeprefix("k."): text.partition(": give ")[2] for name, _, text in said}


@pytest.mark.parametrize(
    ("called", "name", "fit", "others", "said"),
    [
        (SignalDecoder, "file_rate", [20, 1e4], [-5, math.inf], "a number in [19, 210000]"),
        (SignalDecoder, "file_rate", [], ["nonesuch", {"a": 1}, [1], True, math.nan], "a number"),
        (SignalDecoder, "channels", [None, [0, 1]], [-5, {"a": 1}, "x"], "a list or null"),
        (PhotoDecoder, "resize", [None, 1, 8192], [-5, 8193], "a number in [1, 8192] or null"),
        (PhotoDecoder, "resize", [], ["nonesuch", {"a": 1}, 1.5], "a whole number or null"),
        (PhotoDecoder, "half_scale", [True], [1, "yes", None], "true or false"),
        (CSVLogger, "name", ["a"], [-5, {"a": 1}, [1]], "text or null"),
        (TensorBoardLogger, "save_dir", ["a", Path("a")], [-5], "text, in quotes of two kinds"),
        (torch.optim.AdamW, "lr", [1, 1e-3], ["fast", {"a": 1}], "a number"),
        (torch.optim.AdamW, "betas", [[0.9, 0.99]], [[0.9], [1, 1, 1]], "a list of 2"),
        (ModelCheckpoint, "train_time_interval", [timedelta(1), None], [], ""),
        (Reader, "days", [["a"]], [[1]], "a list, each text or null"),
    ],
)
def test_a_value_fits_or_what_is_taken_is_said(called, name, fit, others, said):
    for value in fit:
        assert wanted(called, **{name: value}) == {}
    for value in others:
        assert wanted(called, **{name: value}) == {name: said}


def test_defaults_nodes_and_what_is_not_annotated_pass():
    def function(a, b: float = None, d: "NoSuch" = 1): ...  # noqa: F821, RUF013

    def known(a, b: float = None, c: Literal["x", "y"] = "x", **more: int): ...  # noqa: RUF013

    assert wanted(function, a=1, b="x", d="z") == {}  # no annotation of it can be read
    assert wanted(known, a={}, b=None, c="y", other="z") == {}
    assert wanted(known, b={"_target_": "a.B"}) == {}
    assert wanted(known, b="x", c="z") == {"b": "a number", "c": "one of x, y"}
    assert wanted(torch.zeros, size="x") == {}


class Grand:
    def __init__(self, far: int = 0, **more: int) -> None: ...


class Parent(Grand):
    def __init__(self, size: int, *, sort: Literal["x", "y"]) -> None: ...


class Child(Parent):
    def __init__(self, *args: Any, sort: str, **more: Any) -> None: ...


def test_kwargs_are_those_of_the_class_that_they_are_handed_on_to():
    assert wanted(Child, size="a", sort="z", far="b") == {"size": "a whole number"}
    assert [*signature_of(Child).parameters] == ["args", "sort", "size", "more"]
    assert [*signature_of(Grand).parameters] == ["far", "more"]


def test_fields_of_a_reader_are_what_their_types_say():
    node = {"_target_": f"{__name__}.Reader", "root": "a"}
    made = build(
        "data.reader", {**node, "rate": "1e3", "day": 5, "days": [1, "1_0"], "swapped": "true"}
    )
    assert made == Reader("a", 1000.0, "5", ["1", "1_0"], 1, True)
    for values, said in (
        ({"root": None}, "root is None: give text"),
        ({"number": 65}, r"number is 65: give a number in \[1, 64\]"),
        ({"day": {"a": 1}}, "day is {'a': 1}: give text or null"),
        ({"rate": "fast", "number": "x"}, "rate is 'fast': give a number; .*number is 'x'"),
    ):
        with pytest.raises(UserError, match=rf"data\.reader\.{said}"):
            build("data.reader", {**node, **values})


def test_a_truth_value_is_typed_as_omegaconf_reads_it():
    def function(given: bool, number: int | bool = 0): ...

    for word in ("true", "False", "yes", "NO", "on", "off", "y", "n", 1, 0):
        read = BooleanNode(word)._value()
        assert converted(function, {"given": word}) == {"given": read}
        assert type(converted(function, {"given": word})["given"]) is bool
    assert converted(function, {"given": 2, "number": 1}) == {"given": 2, "number": 1}


WRONG = [
    "decode.file_rate={a:1}", "decode.file_rate=-5", "decode.channels=-5", "decode.sampling_rate=0",
    "decode.channels={a:1}", "fit.optimizer.betas={a:1}", "fit.optimizer.weight_decay=nonesuch",
]  # fmt: skip


@pytest.mark.parametrize(
    "case",
    [
        *(f"model=haptic model.haptic.{each}" for each in WRONG),
        *(f"model=visual model.visual.decode.resize={each}" for each in ("nonesuch", -5, "{a:1}")),
        *(f"model=haptic logger.csv.name={each}" for each in (-5, "{a:1}")),
        "model=haptic logger.tensorboard.name=-5",
        "model=haptic data=folder data.root=null",
    ],
)
def test_wrong_values_of_nodes_are_one_sentence_before_data_is_read(
    case, cli, monkeypatch, tmp_path
):
    def read(data, *_, **__):
        assert data.root is None, "data is read"
        return build("data.reader", data.reader)

    for module in ("studies.dataset", "data.derived_settings"):
        monkeypatch.setattr(f"tex_lightning.{module}.read_recordings", read)
    outcome = cli(*case.split(), f"hydra.run.dir={tmp_path}/run")
    assert (outcome.status, outcome.err.count("\n")) == (2, 1), outcome.err
    key = case.split()[-1].partition("=")[0].removeprefix("data.root")
    assert key in outcome.err
    assert "give" in outcome.err


class Reached(Exception):
    """The training would begin."""


VALUES = ["nonesuch", -5, 0, math.nan, math.inf, 1e30, 10**30, "", [], {}, [1], ["a"], {"a": 1}]
VALUES += [None, True, [[1]], "/dev/null", -0.5, [None], 1.5]
TRIED = 120  # of each model


def typed(value: object) -> str:
    text = json.dumps(value).replace('"a": 1', "a: 1")
    return text.replace("NaN", "nan").replace("Infinity", "inf")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("model", ["model=haptic", "model=fusion", "experiment=few/haptic"])
def test_no_value_of_a_key_ends_in_a_traceback_before_the_training(
    model, surfaces, cache, tmp_path, monkeypatch
):
    def reached(*_: object, **__: object) -> None:
        raise Reached

    monkeypatch.setattr("tex_lightning.tasks.fit.train_and_test", reached)
    folder = ["data=folder", f"data.root={surfaces}", f"data.cache_dir={cache}"]
    given = [model, "debug=tiny", "data.half_scale=false", *folder]
    keys = sorted(flatten(OmegaConf.to_container(compose_config(given), resolve=False)))
    keys = [
        key for key in keys if not key.endswith("_target_") and not key.startswith("data.cache")
    ]
    chance, failed = random.Random(0), {}
    for _ in range(TRIED):
        override = f"++{chance.choice(keys)}={typed(chance.choice(VALUES))}"
        hydra = OmegaConf.create({"hydra": {"job": {"num": 0}}})
        asked = (*given, override)
        try:
            run_task(Job(asked, tmp_path, "command", True, (), compose_config(asked), hydra))
        except Reached:
            continue
        except Exception as error:
            if to_user_error(error, began=True) is None:
                failed[override] = repr(error)
    assert failed == {}
