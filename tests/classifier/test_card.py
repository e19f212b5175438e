"""Cards that were damaged, or that another version wrote; the threshold of unknown recordings."""

from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import make_card, save_classifier
from hypothesis import given
from hypothesis import strategies as st

from tex_lightning.classifier.card import (
    Card,
    configured_card,
    least_rate,
    novelty_threshold,
)
from tex_lightning.classifier.checkpoint import read_checkpoint
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DecisionConfig
from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.errors import UserError

CARD = make_card("haptic", classes=["a", "b"], width=0.1)
FUSION = make_card("haptic", "visual", "sound", classes=["a", "b"], width=0.1)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("senses", {}),
        ("senses.haptic", 3),
        ("senses.haptic.network", {"width": 0.1}),
        ("decision.rule", "median"),
        ("decision.pairs", "many"),
        ("decision.seed", -1),
        ("decision.unknown", float("nan")),
        ("senses.haptic.axes", "frames"),
        ("senses.haptic.width", 1e30),
        ("senses.haptic.decode.sampling_rate", "fast"),
        ("classes", ["a", 5]),
        ("calibration", {"temperature": 0}),
        ("input_ranges", {"haptic": {"level": ["low", 1]}}),
        ("trained_on", {"fold": 1}),
        ("senses.haptic.decode", {"speed": 1}),
        ("decision", {}),
    ],
)
def test_a_value_that_cannot_be_meant_is_said_when_it_is_loaded(tmp_path, key, value):
    card = CARD.to_dict()
    *outer, last = key.split(".")
    place = card
    for name in outer:
        place = place[name]
    place[last] = value
    save_classifier(SurfaceClassifier(CARD), tmp_path / "m.ckpt", hyper_parameters={"card": card})
    with pytest.raises(
        UserError, match=rf"is damaged or was not written by tex_lightning|cannot be used: .*{last}"
    ) as caught:
        SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt")
    assert len(str(caught.value)) < 400


def test_the_card_of_some_senses_is_that_of_a_network_of_them():
    pair = FUSION.of(["visual", "sound"])
    assert pair == make_card("visual", "sound", classes=["a", "b"], width=0.1)
    single = FUSION.of(["haptic"])
    assert (single.kind, single.fusion) == ("haptic", {})


def test_a_decision_given_goes_before_the_cards():
    decision = DecisionConfig(pairs=None, rule=None, seed=None, unknown=None)
    assert CARD.deciding(decision) == CARD
    decision = DecisionConfig(pairs=None, rule="mean", seed=None, unknown=0)
    changed = CARD.deciding(decision)
    assert changed.decision == {**CARD.decision, "rule": "mean", "unknown": 0}


def test_a_network_larger_than_its_file_and_weights_of_nan_are_refused(tmp_path):
    classifier, card = SurfaceClassifier(CARD), CARD.to_dict()
    card["senses"]["haptic"]["width"] = 8.0
    save_classifier(classifier, tmp_path / "m.ckpt", hyper_parameters={"card": card})
    with pytest.raises(UserError, match=r"m.ckpt cannot be used: .*more weights than the file"):
        SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt")
    torch.nn.init.constant_(next(classifier.parameters()), torch.nan)
    save_classifier(classifier, tmp_path / "m.ckpt")
    with pytest.raises(UserError, match="is damaged or was not written"):
        SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt")


@given(st.integers(1, 60), st.floats(0.01, 0.99))
def test_a_new_recording_among_the_known_ones_is_rejected_rarely_enough(count, rate):
    """Each of n + 1 is as likely to be the new one, so all are tried."""
    every = np.random.default_rng(count).permutation(count + 1).astype(float)
    rejected = [new > novelty_threshold([*every[every != new]], rate) for new in every]
    assert np.mean(rejected) <= max(rate, least_rate(count)) + 1e-9
    if rate >= least_rate(count):  # and hardly less often
        assert np.mean(rejected) > rate - least_rate(count) - 1e-9


def test_the_threshold_is_the_conformal_quantile():
    known = np.random.default_rng(0).exponential(size=99)
    expected = np.quantile(known, 95 / 99, method="inverted_cdf")
    assert novelty_threshold(known.tolist(), 0.05) == pytest.approx(expected)


class Payload:
    """Writes a file where it is read by pickle."""

    def __init__(self, target):
        self.target = target

    def __reduce__(self):
        return Path.touch, (self.target,)


def test_a_checkpoint_that_would_run_code_is_refused_and_runs_none(tmp_path):
    touched = tmp_path / "touched"
    torch.save({"state_dict": Payload(touched)}, tmp_path / "a.ckpt")
    with pytest.raises(UserError, match=r"a\.ckpt is damaged or was not written by tex_lightning"):
        read_checkpoint(tmp_path / "a.ckpt")
    assert not touched.exists()
    torch.load(tmp_path / "a.ckpt", weights_only=False)
    assert touched.exists()  # so that the file would have done it


def test_a_card_of_an_earlier_version_leaves_out_what_were_defaults_then(tmp_path):
    card = make_card("haptic", classes=["a", "b"], width=1.0, scale="linear")
    classifier, stored = SurfaceClassifier(card), card.to_dict()
    for name in ("width", "dropout", "scale"):
        del stored["senses"]["haptic"][name]
    stored["senses"]["haptic"]["other_gain"] = None  # of trainings
    save_classifier(classifier, tmp_path / "m.ckpt", hyper_parameters={"card": stored})
    loaded = SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt")
    assert loaded.senses["haptic"].features.scale == "linear"
    assert "other_gain" not in loaded.card.senses["haptic"]
    weights = classifier.state_dict()
    assert all(torch.equal(weights[name], x) for name, x in loaded.state_dict().items())


def test_a_card_of_today_says_what_its_configuration_leaves_to_the_classes():
    config = read_config(compose_config(["~model.haptic.width", "~model.haptic.scale"]))
    card = configured_card(config, ["a", "b"])
    node = card.senses["haptic"]
    assert (node["network"]["width"], node["features"]["scale"]) == (0.48, "mel")
    assert Card.from_dict(card.to_dict()) == card
    whole = configured_card(read_config(compose_config()), ["a", "b"])
    assert "width" not in whole.senses["haptic"]["network"]  # it stands beside it
