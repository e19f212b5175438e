"""The card of a checkpoint: plain values from which its classifier is built again."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from functools import cached_property
from math import inf
from typing import Annotated, Any, Self

from tex_lightning.config import Config, DecisionConfig
from tex_lightning.config.model import FUSION, FusionConfig, kind_of
from tex_lightning.config.signatures import TARGET, misfits
from tex_lightning.config.static_signatures import read_signature
from tex_lightning.errors import shorten

LABEL = "unknown"
CROSSVAL = "crossval"  # of the training, if the same settings were cross-validated
ROUNDING = 1e-9  # of a rate times a number of recordings

DECISION = ("pairs", "rule", "seed", "unknown")  # that the card keeps
NOVELTIES = "novelties"  # of the calibration
POSITIVE = "[1, inf)"


@dataclass
class Measured:
    """Ranges of the numbers in ``calibration`` and ``training`` of a card."""

    temperature: Annotated[float, "[1e-6, 1e6]"]
    fit_seconds: Annotated[float, "[0, inf)"]
    correct: Annotated[float, "[0, inf)"]
    test_samples: Annotated[float, POSITIVE]
    vote_accuracy: Annotated[float, "[0, 1]"]
    folds: Annotated[float, POSITIVE]


# The class whose annotations check each part of a card; senses are checked by their own classes.
SCHEMAS: dict[str, type] = {
    "decision": DecisionConfig,
    "fusion": FusionConfig,
    "calibration": Measured,
    "training": Measured,
    f"training.{CROSSVAL}": Measured,
}


# By class the values of arguments that cards of earlier versions leave out; newer cards have them.
FORMER: dict[str, dict[str, float | str]] = {
    "tex_lightning.networks.hapticnet.HapticNet": {"width": 1.0, "dropout": 0.5},
    "tex_lightning.networks.visualnet.VisualNet": {"dropout": 0.5},
    "tex_lightning.senses.features.spectrogram.SpectrogramFeatures": {"scale": "linear"},
}
GONE = {"other_gain"}  # arguments of such cards that told only how to train


@dataclass(frozen=True)
class Card:
    """Description of a classifier in plain values.

    Attributes:
        classes: Class names in the order of the network's outputs.
        senses: By the name of each sense its settings, from which
            :func:`~tex_lightning.senses.making.make_sense` makes it: ``_target_``, ``modality``,
            ``decode``, ``features``, ``network`` and their arguments.
        decision: ``pairs`` and ``seed`` of FusionNet's vote, ``rule`` and ``unknown``.
        fusion: ``level`` of FusionNet; empty for a single sense.
        baseline: ``name`` of a baseline, its ``node`` of the configuration, the ``budget`` that it
            was given and the ``weights`` it started from;
            empty for this package's networks.
        calibration: What was set on the validation fold: ``temperature`` of the probabilities, and
            by sense the ``novelties`` of known samples
            (:mod:`~tex_lightning.learning.finish`). Entries that could not be set are absent.
        trained_on: ``seen``, digests of the training recordings, which may not be tested on; the
            keys of ``data`` that name the fold to test on; and ``trunks``, the source of each
            trunk's first weights if they were not random.
        input_ranges: By modality, smallest and largest value of each measure of the training
            recordings (:func:`~tex_lightning.data.inspection.training_ranges`); empty if not known.
        training: ``fit_seconds``, the time of the training; ``val_loss``, the loss on the
            validation fold or None; and ``left_out``, by sense the novelties of training recordings
            when they are left out, empty if layers before the scores were trained on them.
            ``crossval`` has the result of a cross-validation with the same settings: ``correct``,
            ``test_samples``, ``vote_accuracy``, ``vote_ci95`` and the number of ``folds``.
    """

    classes: list[str]
    senses: dict[str, dict[str, Any]]
    decision: dict[str, Any]
    fusion: dict[str, Any] = field(default_factory=dict)
    baseline: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, Any] = field(default_factory=dict)
    trained_on: dict[str, Any] = field(default_factory=dict)
    input_ranges: dict[str, dict[str, list[float]]] = field(default_factory=dict)
    training: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values for a checkpoint."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Self:
        """Read the plain values back.

        Raises:
            KeyError: If a value is missing.
            ValueError: If a value is out of its range or of a wrong type.
        """
        card = cls(**{entry.name: stored[entry.name] for entry in fields(cls)})
        _check(card)
        senses = {
            name: _completed({key: sense[key] for key in sense if key not in GONE}, FORMER)
            for name, sense in card.senses.items()
        }
        return replace(card, senses=senses)

    def deciding(self, decision: DecisionConfig) -> Self:
        """Return the card with the decision replaced, except for values that are None."""
        values = {key: getattr(decision, key) for key in DECISION}
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
        return tuple(dict.fromkeys(sense["modality"] for sense in self.senses.values()))

    @property
    def title(self) -> str:
        """Its name in messages."""
        return str(self.baseline.get("name", f"{self.kind} network"))

    def of(self, senses: Sequence[str]) -> Self:
        """Return the card of the classifier by some of the senses, without a temperature."""
        chosen = {name: self.senses[name] for name in senses}
        fusion = self.fusion if len(chosen) > 1 else {}
        kept = {name: self.novelties[name] for name in senses if name in self.novelties}
        calibration = {NOVELTIES: kept} if kept else {}
        return replace(self, senses=chosen, fusion=fusion, calibration=calibration)

    @cached_property
    def rule(self) -> str:
        """Name of the decision rule, a key of ``RULES``."""
        return str(self.decision["rule"])

    @property
    def unknown(self) -> float:
        """Share of known recordings that may be called unknown; 0 calls none unknown."""
        return self.decision.get("unknown") or 0.0

    @property
    def novelties(self) -> dict[str, list[float]]:
        """Novelties of the known samples by sense; empty if they were not measured."""
        novelties: dict[str, list[float]] = self.calibration.get(NOVELTIES, {})
        return novelties

    @property
    def known_novelties(self) -> list[float]:
        """Novelty of each known sample, the sum over the senses."""
        return [sum(values) for values in zip(*self.novelties.values(), strict=True)]

    @cached_property
    def unknown_above(self) -> float | None:
        """The novelty above which a sample is called unknown; None if none is."""
        known = self.known_novelties
        return novelty_threshold(known, self.unknown) if known and self.unknown else None

    @cached_property
    def temperature(self) -> float:
        """Divisor of the logits before the softmax."""
        temperature: float = self.calibration.get("temperature", 1.0)
        return temperature


def configured_card(config: Config, classes: list[str]) -> Card:
    """Return the card of a configuration's classifier before any training."""
    model, sources = config.model, config.sources
    baseline = {
        "name": model.name,
        "node": model.baseline,
        "budget": model.budget,
        "weights": next(iter(sources.values()), None),
    }
    return Card(
        classes=classes,
        senses={name: _completed(model.sense(name).node, _defaults()) for name in model.senses},
        decision={key: getattr(config.decision, key) for key in DECISION},
        fusion={"level": model.fusion.level} if len(model.senses) > 1 else {},
        baseline={} if model.baseline is None else baseline,
    )


def _defaults() -> dict[str, dict[str, Any]]:
    """Return today's defaults of the arguments in :data:`FORMER`."""
    return {
        target: {name: signature.parameters[name].default for name in arguments}
        for target, arguments in FORMER.items()
        if (signature := read_signature(target)) is not None
    }


def _completed(sense: dict[str, Any], defaults: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the settings of a sense with the missing arguments of its features and network."""
    parts = {}
    for kind in ("features", "network"):
        values = defaults.get(sense[kind][TARGET], {})
        missing = {name: values[name] for name in values if name not in {*sense, *sense[kind]}}
        parts[kind] = {**sense[kind], **missing}
    return {**sense, **parts}


def novelty_threshold(known: Sequence[float], rate: float) -> float:
    """Return the novelty above which a recording is called unknown: split conformal prediction.

    A new known recording that is exchangeable with n given ones exceeds the k-th largest of them
    with a probability of at most k / (n + 1) (Vovk et al. 2005, Lei et al. 2018). If ``rate`` is
    below 1 / (n + 1), the largest is returned; see :func:`least_rate`.

    Args:
        known: Novelties of at least one known recording that nothing was fitted to.
        rate: Share of known recordings that may be called unknown, in (0, 1).
    """
    place = max(1, int((len(known) + 1) * rate + ROUNDING))
    return sorted(known)[-place]


def least_rate(known: int) -> float:
    """Return the smallest rate of false rejections that so many recordings can guarantee."""
    return 1 / (known + 1)


def _check(card: Card) -> None:
    """Check the values of a card.

    Raises:
        ValueError: Naming the value.
    """
    _check_senses(card.senses)
    required = card.rule, card.decision["pairs"], card.decision["seed"]
    if None in required or (card.kind == FUSION and "level" not in card.fusion):
        raise ValueError("its decision is not complete")
    for key in ("decision", "fusion", "calibration", "input_ranges", "training"):
        _check_values(key, getattr(card, key))
    if card.novelties and set(card.novelties) != set(card.senses):
        raise ValueError("its calibration.novelties are not those of its senses")
    if card.trained_on and not isinstance(card.trained_on.get("seen"), list):
        raise ValueError("its trained_on.seen is no list")
    others = [name for name in card.classes if not isinstance(name, str)]
    if others or not isinstance(card.classes, list) or len(set(card.classes)) != len(card.classes):
        raise ValueError("its classes are not a list of different names")


def _check_senses(senses: Mapping[str, Any]) -> None:
    """Check that there are senses, each with modality, decoder and classes."""
    if not isinstance(senses, dict) or not senses:
        raise ValueError("it has no senses")
    for name, sense in senses.items():
        if not isinstance(sense["modality"], str) or not isinstance(sense["decode"], dict):
            raise ValueError(f"its senses.{name} has no modality or decoder")
        for part in (sense, sense["features"], sense["network"]):
            if TARGET not in part or not isinstance(part, dict):
                raise ValueError(f"its senses.{name} names no class")


def _check_values(where: str, value: object) -> None:
    """Check the values below a key of the card."""
    if isinstance(value, dict):
        schema = SCHEMAS.get(where)
        for complaint in misfits(where, schema, value) if schema else ():
            raise ValueError(f"its {complaint}")
        for name, part in value.items():
            _check_values(f"{where}.{name}", part)
    elif where.startswith((f"calibration.{NOVELTIES}", "input_ranges", "training.left_out")):
        for number in value if isinstance(value, list) else [value]:
            # null of a recording that is never left out
            if number is not None and not (isinstance(number, int | float) and 0 <= number < inf):
                raise ValueError(f"its {where} is {shorten(repr(number))}")
