"""Cards that were damaged, or that another version wrote."""

import pytest
import torch

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import DecisionConfig
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.errors import UserError

NETWORK = {"width": 0.1, "norm": "batch", "dropout": 0.5}
CARD = Card(
    kind="haptic",
    classes=["a", "b"],
    decode=DecodeSettings().to_dict(),
    decision={"pairs": 10, "seed": 0, "rule": "vote", "reject_below": None},
    haptic_features={"axes": "frame", "scale": "mel", "normalisation": "standard"},
    haptic_network=NETWORK,
)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("kind", "tactile"),
        ("kind", 3),
        ("decision.rule", "median"),
        ("decision.rule", ["vote"]),
        ("decision.pairs", "many"),
        ("decision.seed", -1),
        ("decision.reject_below", float("nan")),
        ("haptic_features.axes", "frames"),
        ("haptic_features.scale", "bark"),
        ("haptic_features.normalisation", "none"),
        ("haptic_network.norm", "layer"),
        ("haptic_network.width", 1e30),
        ("haptic_network.width", "wide"),
        ("decode.sampling_rate", None),
        ("classes", ["a", 5]),
        ("classes", "ab"),
        ("calibration", {"temperature": 0}),
        ("input_ranges", {"level": ["low", 1]}),
        ("trained_on", {"fold": 1}),
        ("haptic_features", {"colour": 1}),
        ("decode", {"speed": 1}),
        ("decision", {}),
    ],
)
def test_a_value_that_cannot_be_meant_is_said_when_it_is_loaded(tmp_path, key, value):
    card = CARD.to_dict()
    outer, _, inner = key.partition(".")
    card[outer] = {**card[outer], inner: value} if inner else value
    state = {f"classifier.{k}": v for k, v in SurfaceClassifier(CARD).state_dict().items()}
    content = {"hyper_parameters": {"card": card}, "state_dict": state}
    torch.save(content, tmp_path / "m.ckpt")
    with pytest.raises(UserError, match="is damaged or was not written by tex_lightning") as caught:
        SurfaceClassifier.from_checkpoint(tmp_path / "m.ckpt")
    assert len(str(caught.value)) < 400
    if inner:
        assert f"its {key} is" in str(caught.value)


def test_a_decision_given_goes_before_the_cards():
    given = DecisionConfig(pairs=None, rule=None, seed=None, reject_below=None)
    assert CARD.deciding(given) == CARD
    given = DecisionConfig(pairs=None, rule="mean", seed=None, reject_below=0)
    changed = CARD.deciding(given)
    assert changed.decision == {**CARD.decision, "rule": "mean", "reject_below": 0}
