"""What a checkpoint says of itself: plain values that rebuild the classifier."""

import math
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self, get_args

import torch

from tex_lightning.config import DecisionConfig
from tex_lightning.config.trust import require_trust
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.data.folds import NEEDS, Kind
from tex_lightning.decision.voting import RULES
from tex_lightning.errors import UserError, shorten
from tex_lightning.features.spectrogram import Axes, Normalisation, Scale
from tex_lightning.networks.blocks import NORMS, Level

SUFFIX = ".ckpt"  # of checkpoints of this package

# values that cards of older checkpoints lack
LATER: dict[str, Any] = {"baseline": {}, "calibration": {}, "input_ranges": {}}
DECISION = ("pairs", "rule", "seed", "reject_below")  # of the configuration, kept by the card
MAX_WIDTH = 100  # a card that says more is damaged, and its network would not fit into memory


@dataclass(frozen=True)
class Card:
    """What a classifier is made of, in plain values.

    Attributes:
        kind: haptic, visual or fusion.
        classes: Class names; the network's outputs in order.
        decode: :class:`DecodeSettings` as a dictionary.
        haptic_features: Arguments of :class:`HapticFeatures`; empty for VisualNet.
        haptic_network: Arguments of :class:`HapticNet` but the classes.
        visual_network: ``trunk`` as a node of the configuration, its ``width`` and ``norm``, and
            arguments of :class:`VisualNet`.
        fusion: ``level`` of FusionNet; empty for the others.
        baseline: ``name`` of a baseline, its ``node`` of the configuration, the ``budget`` that it
            was given and the ``weights`` it started from;
            empty for this package's networks.
        decision: ``pairs`` and ``seed`` of FusionNet's vote, ``rule``, and ``reject_below``.
        calibration: What was set on the validation fold: ``temperature`` of the probabilities, and
            perhaps ``confidence_threshold`` of sequential decisions; empty without such a fold.
        trained_on: ``seen``, digests of the recordings behind the weights, to refuse testing on
            them, and the keys of ``data`` that say on which fold they may be tested; ``trunks``,
            what each trunk began from if not at random.
        input_ranges: Smallest and largest level, rate, brightness and contrast of the training
            recordings (:func:`~tex_lightning.data.quality.training_ranges`); empty if not known.
    """

    kind: Kind
    classes: list[str]
    decode: dict[str, Any]
    decision: dict[str, Any]
    haptic_features: dict[str, Any] = field(default_factory=dict)
    haptic_network: dict[str, Any] = field(default_factory=dict)
    visual_network: dict[str, Any] = field(default_factory=dict)
    fusion: dict[str, Any] = field(default_factory=dict)
    baseline: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, float] = field(default_factory=dict)
    trained_on: dict[str, Any] = field(default_factory=dict)
    input_ranges: dict[str, list[float]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a checkpoint."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Self:
        """Read the plain values back, also those of older checkpoints.

        Raises:
            KeyError: If a value is missing that has always been there.
            ValueError: If a value cannot be meant.
            UserError: If it names a class of a package that is not trusted.
        """
        values = {**LATER, **stored}
        card = cls(**{entry.name: values[entry.name] for entry in fields(cls)})
        if card.haptic_features:  # what there was before there was a choice
            card.haptic_features.setdefault("axes", "trace")
            card.haptic_features.setdefault("scale", "linear")
        _check(card)
        require_trust("The checkpoint", [card.visual_network, card.baseline])
        return card

    def deciding(self, given: DecisionConfig) -> Self:
        """The same card with those parts of the decision that are given; None leaves the card's."""
        values = {key: getattr(given, key) for key in DECISION}
        changed = {key: value for key, value in values.items() if value is not None}
        return replace(self, decision={**self.decision, **changed})

    @property
    def title(self) -> str:
        """What it is called in messages."""
        return str(self.baseline.get("name", f"{self.kind} network"))

    @property
    def rule(self) -> str:
        """How fragments decide, a key of ``RULES``; older checkpoints count votes."""
        return str(self.decision.get("rule", "vote"))

    @property
    def reject_below(self) -> float | None:
        """Mean class probability below which no label is given; None always gives one."""
        return self.decision.get("reject_below")

    @property
    def temperature(self) -> float:
        """What logits are divided by before they become probabilities."""
        return self.calibration.get("temperature", 1.0)

    @property
    def settings(self) -> DecodeSettings:
        """How files are decoded for this classifier."""
        return DecodeSettings(**self.decode)

    def settings_for(self, file_rate: float | None) -> DecodeSettings:
        """The same for files at another rate in Hz than those of the training; None for theirs."""
        return self.settings if file_rate is None else replace(self.settings, file_rate=file_rate)


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """The tensors and plain values of a checkpoint.

    Raises:
        UserError: If the file is missing or no checkpoint.
    """
    path = Path(path).expanduser()
    if not path.is_file():
        raise UserError(f"Checkpoint {path} does not exist; check the path.")
    try:
        content: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # damage shows in as many ways as there are formats
        raise damaged(path, error) from error
    return content


def damaged(path: Path, error: Exception) -> UserError:
    """What to say of a checkpoint that cannot be read."""
    what = str(error) if isinstance(error, CardError) else type(error).__name__
    return UserError(
        f"Checkpoint {path} is damaged or was not written by tex_lightning of this version "
        f"({what}); give a file from a run's checkpoints folder, or train anew."
    )


class CardError(ValueError):
    """A value of a card that cannot be meant."""


def _check(card: Card) -> None:
    """Refuse a card whose values would fail, or be misread, only when they are used.

    Raises:
        CardError: Naming the value.
    """
    features, decision = card.haptic_features, card.decision
    _among("kind", card.kind, tuple(NEEDS))
    _among("decision.rule", card.rule, tuple(RULES))
    if features:
        _among("haptic_features.axes", features["axes"], get_args(Axes))
        _among("haptic_features.scale", features["scale"], get_args(Scale))
        normalisation = features.get("normalisation", "standard")
        _among("haptic_features.normalisation", normalisation, get_args(Normalisation))
        _number("haptic_features.sampling_rate", features.get("sampling_rate", 10_000), 1, 1e9)
    if card.visual_network and not isinstance(card.visual_network.get("trunk"), dict):
        raise CardError(f"its visual_network.trunk is {card.visual_network.get('trunk')!r}")
    for name, network in (("haptic", card.haptic_network), ("visual", card.visual_network)):
        if network:
            _number(f"{name}_network.width", network.get("width", 1), 0, MAX_WIDTH)
            _among(f"{name}_network.norm", network.get("norm", "batch"), NORMS)
    if card.kind == "fusion":
        _among("fusion.level", card.fusion["level"], get_args(Level))
    _number("decision.pairs", decision["pairs"], 1, 1e9)
    _number("decision.seed", decision["seed"], 0, 2**32 - 1)
    _number("decision.reject_below", card.reject_below or 0, 0, 1)
    _number("calibration.temperature", card.temperature, 1e-6, 1e6)
    _number("decode.sampling_rate", card.settings.sampling_rate, 1, 1e9)
    _number("decode.file_rate", card.settings.file_rate, 1e-3, 1e9)
    threshold = card.calibration.get("confidence_threshold", 0)
    _number("calibration.confidence_threshold", threshold, 0, 1)
    for name, ends in card.input_ranges.items():
        for end in ends:
            _number(f"input_ranges.{name}", end, 0, math.inf)
    if card.trained_on and not isinstance(card.trained_on.get("seen"), list):
        raise CardError("its trained_on.seen is no list")
    names = [name for name in card.classes if not isinstance(name, str)]
    if names or not isinstance(card.classes, list) or len(set(card.classes)) != len(card.classes):
        raise CardError("its classes are not a list of different names")


def _among(key: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise CardError(f"its {key} is {shorten(repr(value))}")


def _number(key: str, value: object, low: float, high: float) -> None:
    if not isinstance(value, int | float) or not math.isfinite(value) or not low <= value <= high:
        raise CardError(f"its {key} is {shorten(repr(value))}")
