"""The metadata of a checkpoint: plain values that rebuild the classifier."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self, get_args

import torch

from tex_lightning.classifier.unknown import novelty_threshold
from tex_lightning.classifier.vote import RULES
from tex_lightning.config import DecisionConfig
from tex_lightning.config.instantiation import TARGET
from tex_lightning.config.model import FUSION, LARGEST, kind_of
from tex_lightning.config.tasks import MAX_PAIRS
from tex_lightning.core.console import suppress_warnings
from tex_lightning.core.contract import fault_of
from tex_lightning.errors import UserError, shorten
from tex_lightning.networks.archives import check_archive
from tex_lightning.networks.blocks import NORMS, Level
from tex_lightning.senses.features.spectrogram import Axes, Normalisation, Scale

SUFFIX = ".ckpt"  # of checkpoints of this package

DECISION = ("pairs", "rule", "seed", "reject_below", "unknown")  # that the card keeps
NOVELTIES = "novelties"  # of the calibration
LEFT_OUT = "left_out_novelties"  # of a checkpoint
MAX_WIDTH = 100  # a card that says more is damaged, and its network would not fit into memory
CHOICES: dict[str, tuple[str, ...]] = {
    "norm": NORMS,
    "axes": get_args(Axes),
    "scale": get_args(Scale),
    "normalisation": get_args(Normalisation),
}
RANGES = {
    "width": (0.0, MAX_WIDTH),
    "sampling_rate": (1.0, 1e6),  # sensors have 20 Hz to 200 kHz
    "file_rate": (1e-3, 1e7),
    "resize": (1, LARGEST),
}


@dataclass(frozen=True)
class Card:
    """Description of a classifier in plain values.

    Attributes:
        classes: Class names; the network's outputs in order.
        senses: By the name of each sense what
            :func:`~tex_lightning.senses.base.make_sense` makes its sense of: ``_target_``,
            ``modality``, ``decode``, ``features``, ``network`` and their arguments.
        decision: ``pairs`` and ``seed`` of FusionNet's vote, ``rule``, ``reject_below`` and
            ``unknown``.
        fusion: ``level`` of FusionNet; empty for a single sense.
        baseline: ``name`` of a baseline, its ``node`` of the configuration, the ``budget`` that it
            was given and the ``weights`` it started from;
            empty for this package's networks.
        calibration: What was set on the validation fold: ``temperature`` of the probabilities, and
            perhaps ``confidence_threshold`` of sequential decisions; and by sense the
            ``novelties`` of known samples (:mod:`~tex_lightning.learning.statistics`). What cannot
            be set is not there.
        trained_on: ``seen``, digests of the recordings behind the weights, to refuse testing on
            them, and the keys of ``data`` that say on which fold they may be tested; ``trunks``,
            what each trunk began from if not at random.
        input_ranges: By modality, smallest and largest value of each measure of the training
            recordings (:func:`~tex_lightning.data.quality.training_ranges`); empty if not known.
    """

    classes: list[str]
    senses: dict[str, dict[str, Any]]
    decision: dict[str, Any]
    fusion: dict[str, Any] = field(default_factory=dict)
    baseline: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, Any] = field(default_factory=dict)
    trained_on: dict[str, Any] = field(default_factory=dict)
    input_ranges: dict[str, dict[str, list[float]]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a checkpoint."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Self:
        """Read the plain values back.

        Raises:
            KeyError: If a value is missing.
            ValueError: If a value cannot be meant.
        """
        card = cls(**{entry.name: stored[entry.name] for entry in fields(cls)})
        _check(card)
        return card

    def deciding(self, given: DecisionConfig) -> Self:
        """Return the card with the given parts of the decision; None keeps the card's."""
        values = {key: getattr(given, key) for key in DECISION}
        changed = {key: value for key, value in values.items() if value is not None}
        return replace(self, decision={**self.decision, **changed})

    @property
    def sense_names(self) -> tuple[str, ...]:
        """Names of the senses, in order."""
        return tuple(self.senses)

    @property
    def kind(self) -> str:
        """Name of the network: its sense, or ``fusion`` for several."""
        return kind_of(self.sense_names)

    @property
    def modalities(self) -> tuple[str, ...]:
        """Modalities of the recordings that it uses, each once."""
        return tuple(dict.fromkeys(each["modality"] for each in self.senses.values()))

    @property
    def title(self) -> str:
        """Its name in messages."""
        return str(self.baseline.get("name", f"{self.kind} network"))

    def of(self, senses: Sequence[str]) -> Self:
        """The card of some of the senses; their temperature is not known."""
        chosen = {name: self.senses[name] for name in senses}
        fusion = self.fusion if len(chosen) > 1 else {}
        kept = {name: self.novelties[name] for name in senses if name in self.novelties}
        calibration = {NOVELTIES: kept} if kept else {}
        return replace(self, senses=chosen, fusion=fusion, calibration=calibration)

    @property
    def rule(self) -> str:
        """How fragments decide, a key of ``RULES``."""
        return str(self.decision["rule"])

    @property
    def reject_below(self) -> float | None:
        """Mean class probability below which no label is given; None always gives one."""
        return self.decision.get("reject_below")

    @property
    def unknown(self) -> float:
        """Share of known recordings that may be called unknown; 0 calls none unknown."""
        return self.decision.get("unknown") or 0.0

    @property
    def novelties(self) -> dict[str, list[float]]:
        """Novelties of known samples by sense, in the same order; empty if not known."""
        found: dict[str, list[float]] = self.calibration.get(NOVELTIES, {})
        return found

    @property
    def known_novelties(self) -> list[float]:
        """Novelties of known samples: the sums over the senses."""
        return [sum(each) for each in zip(*self.novelties.values(), strict=True)]

    @cached_property
    def unknown_above(self) -> float | None:
        """The novelty above which a sample is called unknown; None if none is."""
        known = self.known_novelties
        return novelty_threshold(known, self.unknown) if known and self.unknown else None

    @property
    def temperature(self) -> float:
        """Divisor of the logits before the softmax."""
        found: float = self.calibration.get("temperature", 1.0)
        return found


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """Read the tensors and plain values of a checkpoint.

    Raises:
        UserError: If the file is missing or no checkpoint.
    """
    path = Path(path).expanduser()
    if not path.is_file():
        raise UserError(f"Checkpoint {path} does not exist; check the path.")
    try:
        check_archive(path)
        with suppress_warnings():
            content: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # damage shows in as many ways as there are formats
        raise damaged(path, error) from error
    return content


def damaged(path: Path, error: Exception) -> UserError:
    """Return the error for a checkpoint that cannot be read.

    Raises:
        Exception: The given one, where a user's own class has raised it.
    """
    if fault_of(error) is not None:
        raise error
    what = str(error) if isinstance(error, CardError) else type(error).__name__
    return UserError(
        f"Checkpoint {path} is damaged or was not written by tex_lightning of this version "
        f"({what}); give a file from a run's checkpoints folder, or train anew."
    )


def named(path: Path, error: UserError) -> UserError:
    """Return the error with the path of its checkpoint."""
    if str(path) in str(error):
        return error
    return UserError(f"Checkpoint {path} cannot be used: {error}")


class CardError(ValueError):
    """A value of a card that cannot be meant."""


def _check(card: Card) -> None:
    """Refuse a card whose values would fail, or be misread, only when they are used.

    Raises:
        CardError: Naming the value.
    """
    if not isinstance(card.senses, dict) or not card.senses:
        raise CardError("it has no senses")
    for name, sense in card.senses.items():
        _check_sense(name, sense)
    _among("decision.rule", card.rule, tuple(RULES))
    if card.kind == FUSION:
        _among("fusion.level", card.fusion["level"], get_args(Level))
    _number("decision.pairs", card.decision["pairs"], 1, MAX_PAIRS)
    _number("decision.seed", card.decision["seed"], 0, 2**32 - 1)
    _number("decision.reject_below", card.reject_below or 0, 0, 1)
    _number("decision.unknown", card.unknown, 0, 1)
    _number("calibration.temperature", card.temperature, 1e-6, 1e6)
    threshold = card.calibration.get("confidence_threshold", 0)
    _number("calibration.confidence_threshold", threshold, 0, 1)
    if card.novelties and set(card.novelties) != set(card.senses):
        raise CardError("its calibration.novelties are not those of its senses")
    for name, values in card.novelties.items():
        for value in values:
            _number(f"calibration.novelties.{name}", value, 0, math.inf)
    for modality, ranges in card.input_ranges.items():
        for name, ends in ranges.items():
            for end in ends:
                _number(f"input_ranges.{modality}.{name}", end, 0, math.inf)
    if card.trained_on and not isinstance(card.trained_on.get("seen"), list):
        raise CardError("its trained_on.seen is no list")
    names = [name for name in card.classes if not isinstance(name, str)]
    if names or not isinstance(card.classes, list) or len(set(card.classes)) != len(card.classes):
        raise CardError("its classes are not a list of different names")


def _check_sense(name: str, sense: Mapping[str, Any]) -> None:
    if not isinstance(sense["modality"], str):
        raise CardError(f"its senses.{name}.modality is {shorten(repr(sense['modality']))}")
    parts = {key: sense[key] for key in ("decode", "features", "network")}
    for key, part in {"": sense, **parts}.items():
        if not isinstance(part, dict) or (key != "decode" and TARGET not in part):
            raise CardError(f"its senses.{name}{key and '.'}{key} names no class")
        for leaf, value in part.items():
            where = f"senses.{name}{key and '.'}{key}.{leaf}"
            if leaf in CHOICES:
                _among(where, value, CHOICES[leaf])
            elif leaf in RANGES and value is not None:
                _number(where, value, *RANGES[leaf])


def _among(key: str, value: object, allowed: tuple[str, ...]) -> None:
    if value not in allowed:
        raise CardError(f"its {key} is {shorten(repr(value))}")


def _number(key: str, value: object, low: float, high: float) -> None:
    if not isinstance(value, int | float) or not math.isfinite(value) or not low <= value <= high:
        raise CardError(f"its {key} is {shorten(repr(value))}")
