"""What a checkpoint says of itself: plain values that rebuild the classifier."""

from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Self

import torch

from tex_lightning.data.decode import DecodeSettings
from tex_lightning.data.folds import Kind
from tex_lightning.errors import UserError

# values that cards of older checkpoints lack
LATER: dict[str, Any] = {"baseline": {}, "calibration": {}}


@dataclass(frozen=True)
class Card:
    """What a classifier is made of, in plain values.

    Attributes:
        kind: haptic, visual or fusion.
        classes: Class names; the network's outputs in order.
        decode: :class:`DecodeSettings` as a dictionary.
        haptic_features: Arguments of :class:`HapticFeatures`; empty for VisualNet.
        haptic_network: Arguments of :class:`HapticNet` but the classes.
        visual_network: Arguments of :class:`VisualNet` but the classes.
        fusion: ``level`` of FusionNet; empty for the others.
        baseline: ``name`` and ``settings`` of a baseline and the ``weights`` it started from;
            empty for our networks.
        decision: ``pairs`` and ``seed`` of FusionNet's vote, and ``rule``.
        calibration: What was set on the validation fold: ``temperature`` of the probabilities, and
            perhaps ``enough``, the threshold of sequential decisions; empty without such a fold.
        trained_on: ``seen``, digests of the recordings behind the weights, to refuse testing on
            them, and the keys of ``data`` that say on which fold they may be tested; ``trunks``,
            what each trunk began from if not at random; ``stream``, the synthetic specimens that
            took the place of recordings.
    """

    kind: Kind
    classes: list[str]
    decode: dict[str, Any]
    decision: dict[str, int]
    haptic_features: dict[str, Any] = field(default_factory=dict)
    haptic_network: dict[str, Any] = field(default_factory=dict)
    visual_network: dict[str, Any] = field(default_factory=dict)
    fusion: dict[str, Any] = field(default_factory=dict)
    baseline: dict[str, Any] = field(default_factory=dict)
    calibration: dict[str, float] = field(default_factory=dict)
    trained_on: dict[str, Any] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """Plain values for a checkpoint."""
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: dict[str, Any]) -> Self:
        """Read the plain values back, also those of older checkpoints.

        Raises:
            KeyError: If a value is missing that has always been there.
        """
        values = {**LATER, **stored}
        card = cls(**{entry.name: values[entry.name] for entry in fields(cls)})
        if card.haptic_features:  # what there was before there was a choice
            card.haptic_features.setdefault("axes", "trace")
            card.haptic_features.setdefault("scale", "linear")
        return card

    @property
    def title(self) -> str:
        """What it is called in messages."""
        return str(self.baseline.get("name", f"{self.kind} network"))

    @property
    def rule(self) -> str:
        """How fragments decide, a key of ``RULES``; older checkpoints count votes."""
        return str(self.decision.get("rule", "vote"))

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
    return UserError(
        f"Checkpoint {path} is damaged or was not written by tex_lightning of this version "
        f"({type(error).__name__}); give a file from a run's checkpoints folder, or train anew."
    )
