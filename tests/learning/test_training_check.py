"""Every class of a user's own is tried once: its contract, and what a checkpoint holds of it."""

import logging
import traceback
from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import make_card

from tex_lightning.baselines.classifier import BaselineClassifier
from tex_lightning.classifier.card import Card
from tex_lightning.config.instantiation import trust
from tex_lightning.core.contract import fault_of
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.learning.training_check import check_fitted_baseline, check_sense

RATE = 1000.0
FIT = {
    "epochs": 1,
    "perturb": [],
    "perturbed_copies": 0,
    "sensor_augmentation": 0.0,
    "head_factor": 1.0,
}


@pytest.fixture(autouse=True)
def trusted():
    trust("own_parts", "own_baselines")


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> tuple[Recordings, Store]:
    """Recordings of a force, at a level of its own for each class."""
    folder, rows = tmp_path_factory.mktemp("force"), []
    for number in range(6):
        path = folder / f"{number}.npy"
        np.save(path, number % 2 + np.random.default_rng(number).standard_normal(900))
        rows.append(Recording("ab"[number % 2], "force", path, number))
    return Recordings(tuple(rows)), Store(folder, {"force": SignalDecoder(RATE, RATE)})


def card(features: dict | None = None, network: dict | None = None) -> Card:
    node = {
        "_target_": "tex_lightning.senses.signal.SignalSense",
        "modality": "force",
        "decode": {"sampling_rate": RATE, "file_rate": None, "channels": None},
        "features": {"_target_": "own_parts.Frames", **(features or {})},
        "network": {"_target_": "own_parts.SpoiltNet", **(network or {})},
    }
    whole = make_card("haptic", classes=["a", "b"])
    return Card(classes=whole.classes, senses={"force": node}, decision=whole.decision)


def module(card: Card) -> SurfaceModule:
    return SurfaceModule(card, FIT, 0, {"force": 20})


@pytest.mark.parametrize(
    ("part", "spoil", "said"),
    [
        ("features", "none", "returned a NoneType for a batch of 1"),
        ("features", "array", r"returned a ndarray of float32 of shape \(1, 1, 90\)"),
        (
            "features",
            "batch",
            r"returned a Tensor of float32 of shape \(3, 1, 90\) for a batch of 1",
        ),
        ("features", "complex", r"\(Frames\) returned a Tensor of complex64 of shape \(1, 1, 90\)"),
        ("features", "nan", "holds NaN|gave NaN or infinity"),
        ("features", "empty", "^Frames makes nothing of this force recording .it gives no frame.;"),
        ("features", "outside", "gives other outputs once it is saved and loaded"),
        ("features", "resized", r"\(Frames\) cannot be loaded .*: its constructor makes no learnt"),
        ("network", "later", r"\(SpoiltNet\) cannot be loaded .*: its constructor makes no scale "),
        ("network", "none", "returned a NoneType for a batch of 2"),
        ("network", "batch", r"returned a Tensor of float32 of shape \(6, 2, 16\)"),
        ("network", "flat", r"returned a Tensor of float32 of shape \(2, 2\) for a batch of 2"),
        ("network", "complex", "returned a Tensor of complex64"),
        ("network", "nan", "gave NaN or infinity"),
        ("network", "detached", "without a gradient, so nothing can be trained"),
        ("network", "outside", "gives other outputs once it is saved and loaded"),
    ],
)
def test_parts_that_break_their_contract(world, part, spoil, said):
    with pytest.raises(UserError, match=said):
        check_sense(module(card(**{part: {"spoil": spoil}})), *world)


@pytest.mark.parametrize("spoil", ["", "shape"])
def test_features_are_alike_in_training_and_prediction(world, spoil):
    given = card({"_target_": "own_parts.Fitted", "spoil": spoil})
    if not spoil:
        check_sense(module(given), *world)
        return
    said = r"Fitted\) gives \(1, 1, 90\) by forward\(signal\) and \(1, 1, 1, 1, 90\) by normalise"
    with pytest.raises(UserError, match=said):
        check_sense(module(given), *world)


def test_a_score_layer_of_other_features_is_found_before_the_training(world):
    with pytest.raises(RuntimeError, match="shapes") as caught:
        check_sense(module(card(network={"spoil": "blind"})), *world)
    assert fault_of(caught.value).startswith("model.force.network (SpoiltNet) raised RuntimeError")


@pytest.mark.parametrize("name", ["double", "pop"])
def test_a_sense_with_the_name_of_a_method_is_refused(name):
    given = card()
    with pytest.raises(UserError, match=f"^No sense can be called {name}, .*; rename it"):
        module(replace(given, senses={name: given.senses["force"]}))


def test_layers_that_wait_for_an_input_are_refused():
    node = {"_target_": "own_parts.LazyNet"}
    with pytest.raises(UserError, match=r"^model\.force\.network has lazy layers, .*nn\.Conv1d\("):
        module(card(network=node))


@pytest.mark.parametrize("part", ["features", "network"])
def test_what_a_part_raises_keeps_its_traceback_after_its_key(world, part):
    with pytest.raises(KeyError, match="boom of a user") as caught:
        check_sense(module(card(**{part: {"spoil": "raise"}})), *world)
    said = fault_of(caught.value)
    assert said.startswith(f"model.force.{part} (")
    assert "raised KeyError" in said
    assert traceback.extract_tb(caught.tb)[-1].filename.endswith("own_parts.py")


def test_what_keeps_its_contract_passes(world, caplog):
    with caplog.at_level(logging.WARNING):
        check_sense(module(card({"spoil": "buffer"})), *world)
        assert not caplog.records
        check_sense(module(card({"spoil": "parameter"})), *world)
    assert "model.force.features (Frames) has parameters, and training does not" in caplog.text


def try_loudness(spoil: str) -> None:
    node = {"_target_": "own_baselines.Loudness", "spoil": spoil}
    baseline = {"name": "mine", "node": node, "budget": 1, "weights": None}
    classifier = BaselineClassifier(
        replace(make_card("haptic", classes=["a", "b"]), baseline=baseline)
    )
    rng = np.random.default_rng(0)
    traces = [level * rng.standard_normal(900).astype(np.float32) for level in (1, 9, 1)]
    classifier.baseline.fit(traces, np.array([0, 1, 0]), seed=0, groups="aab")
    check_fitted_baseline(classifier, [torch.from_numpy(trace)[None] for trace in traces])


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        ("none", "returned a NoneType for a recording"),
        ("array", r"returned a ndarray of float\d+ of shape \(2, 1\) for"),
        ("flat", r"returned a Tensor of float\d+ of shape \(2,\) for"),
        ("nan", "gave NaN or infinity"),
        ("more", "gave 4 scores at each position, and there are 2 classes"),
        ("arrays", "has a state that is a dict of other things than tensors"),
        ("outside", "gives other outputs once it is saved and loaded"),
    ],
)
def test_baselines_that_break_their_contract(spoil, said):
    with pytest.raises(UserError, match=rf"^model\.baseline \(Loudness\) {said}.*; a baseline has"):
        try_loudness(spoil)


def test_baselines_that_keep_their_contract_pass_and_what_they_raise_is_theirs():
    try_loudness("")
    with pytest.raises(KeyError) as caught:
        try_loudness("misnamed")
    line = "model.baseline (Loudness) raised KeyError; a baseline has fit("
    assert fault_of(caught.value).startswith(line)
    assert traceback.extract_tb(caught.tb)[-1].filename.endswith("own_baselines.py")
