"""All perturbations by name, with their scales from ``severities.yaml``, and training on them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Self

import numpy as np
from omegaconf import OmegaConf

from tex_lightning.core.contract import (
    Component,
    breach,
    calling,
    check_call,
    describe_value,
    fault_of,
    resolve,
)
from tex_lightning.errors import UserError, reason
from tex_lightning.perturbations import pixels, traces
from tex_lightning.perturbations.pixels import Array, Function, Scene
from tex_lightning_runtime.files import expanded, require_file

SEVERITIES = (1, 2, 3, 4, 5)
MAX_LEVEL = 1e30  # of a level; recordings are float32
SCALES = Path(__file__).with_name("severities.yaml")


@dataclass(frozen=True)
class Perturbation:
    """One perturbation of recordings, with its scale.

    Attributes:
        name: In ``severities.yaml``, unlike all others.
        modality: Modality that it changes.
        unit: Unit of its values.
        levels: Values of severity 0 (nearly harmless) to 5.
        log: Whether the scale between levels is even in logarithms.
        held_out: Whether it is kept from training.
        function: Dotted path of a user's, or name of the package's; None where that is ``name``.
    """

    name: str
    modality: str
    unit: str
    levels: tuple[float, ...]
    log: bool = False
    held_out: bool = False
    function: str | None = None

    @property
    def is_users(self) -> bool:
        """Whether its function is a user's."""
        return self.function is not None and "." in self.function

    def value(self, severity: float) -> float:
        """Return the value, in ``unit``, of any severity from 0 to 5."""
        levels = np.array(self.levels, dtype=np.float64)
        if self.log:
            levels = np.log(levels)
        value = float(np.interp(severity, range(len(levels)), levels))
        return math.exp(value) if self.log else value

    def apply(self, recording: Array, severity: float, scene: Scene) -> Array:
        """Change a recording to one of the same type, not always of the same size.

        Args:
            recording: Signal (axes, samples) float32, or photo (height, width, 3) uint8.
            severity: 0, which leaves it as it is, to 5, whole or between.
            scene: Its circumstances.

        Raises:
            UserError: If a user's function returns no finite recording of this kind.
        """
        if severity == 0:
            return recording
        function, value = _function(self), self.value(severity)
        if self.is_users:
            key = f"{self.name} of {self.modality} in stability.severities"
            changed = perturb((key, "perturbation", function), function, recording, value, scene)
        else:
            changed = np.asarray(function(recording, value, scene))
        if recording.dtype != np.uint8:
            return np.ascontiguousarray(changed, dtype=np.float32)
        if changed.dtype != np.uint8:
            changed = np.rint(np.clip(changed, 0, 255)).astype(np.uint8)
        return np.ascontiguousarray(changed)


@cache
def perturbations() -> dict[str, Perturbation]:
    """Return all perturbations by name, modality by modality."""
    return _read(SCALES)


def read_severities(path: str | Path) -> dict[str, Perturbation]:
    """Return perturbations of a user's own table, in the form of ``severities.yaml``.

    Every line also names its ``function``, by a dotted path or one of the package. It takes a
    signal (axes, samples) float32 or a photo (height, width, 3) uint8, a value between two levels,
    and a :class:`Scene`.

    Raises:
        UserError: If the file, a line or a function cannot be used.
    """
    try:
        table = _read(expanded(path))
        for kind in table.values():
            _check(kind)
    except Exception as error:  # a function's module may fail in any way
        if fault_of(error) is not None:
            raise
        raise UserError(
            f"stability.severities={path} cannot be used: {reason(error)}; write "
            "{image: {NAME: {function: my_ext.NAME, unit: TEXT, levels: [six numbers]}}}."
        ) from error
    return table


def _read(path: Path) -> dict[str, Perturbation]:
    require_file(path)
    content: Any = OmegaConf.to_object(OmegaConf.load(path))
    table: dict[str, Perturbation] = {}
    for modality, entries in content.items():
        for name, entry in entries.items():
            if name in table:
                raise ValueError(f"{name} is there twice")
            values = {**entry, "levels": tuple(entry.get("levels", ()))}
            table[name] = Perturbation(name, modality, **values)
    return table


def _check(kind: Perturbation) -> None:
    if kind.name in perturbations():
        raise ValueError(f"{kind.name} is the name of one of the package")
    if len(kind.levels) != 6 or not all(abs(level) < MAX_LEVEL for level in kind.levels):
        raise ValueError(f"{kind.name} has no six levels, each below {MAX_LEVEL:g}")
    _function(kind)


def perturb(
    part: Component, function: Function, recording: Array, value: float, scene: Scene
) -> Array:
    """Return what a user's function makes of a recording, of any type of numbers.

    Args:
        part: The function, as its contract names it.
        function: The function.
        recording: Signal (axes, samples) float32, or photo (height, width, 3) uint8.
        value: Value in the unit of the perturbation.
        scene: Circumstances of the recording.

    Raises:
        UserError: If it returns no finite recording of this kind.
    """
    check_call(part, function, "recording", "value", "scene")
    with calling(*part):
        changed = np.asarray(function(recording, value, scene))
    channels = -1 if recording.dtype == np.uint8 else 0
    fits = changed.ndim == recording.ndim and changed.shape[channels] == recording.shape[channels]
    if not fits or changed.dtype.kind not in "buif":
        raise breach(
            *part, f"returned {describe_value(changed)} for one of shape {recording.shape}"
        )
    if not np.isfinite(changed).all():
        raise breach(*part, "gave NaN or infinity")
    return changed


def _function(kind: Perturbation) -> Function:
    name = kind.function or kind.name
    known: dict[str, Any] = {**vars(pixels), **vars(traces)}
    given: Function | None = (
        resolve("stability.severities", name) if kind.is_users else known.get(name)
    )
    if not callable(given):
        whose = "" if kind.is_users else " of the package"
        raise ValueError(f"{kind.name} names {name}, which is no function{whose}")
    return given


@dataclass(frozen=True)
class Augmentation:
    """Change a share of the recordings, each by one perturbation at any severity up to the worst.

    Attributes:
        kinds: Perturbations of one modality, drawn evenly.
        share: Share of the recordings that are changed.
        rate: Sampling rate of signals in Hz; photos have none.
    """

    kinds: tuple[Perturbation, ...]
    share: float = 1.0
    rate: float = 0.0

    @classmethod
    def of(cls, names: Sequence[str], share: float = 1.0, rate: float = 0.0) -> Self | None:
        """Return the augmentation by the named perturbations of the package; None without names."""
        return cls(tuple(perturbations()[name] for name in names), share, rate) if names else None

    def __call__(self, recording: Array, rng: np.random.Generator) -> Array:
        """Return the recording as it is, or perturbed, which may change its size."""
        if rng.random() >= self.share:
            return recording
        kind = self.kinds[int(rng.integers(len(self.kinds)))]
        severity = SEVERITIES[-1] * float(rng.random())
        return kind.apply(recording, severity, Scene(rng, self.rate))


def trainable(modality: str) -> tuple[str, ...]:
    """Return the names of the perturbations that may be trained on: those not held out."""
    return tuple(
        name
        for name, kind in perturbations().items()
        if kind.modality == modality and not kind.held_out
    )
