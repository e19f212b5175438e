"""All perturbations by name, with their scales from ``severities.yaml``."""

import math
import pkgutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, cast

import numpy as np
from omegaconf import OmegaConf

from tex_lightning.errors import UserError
from tex_lightning.perturbations import lenses, pixels, strokes, traces
from tex_lightning.perturbations.scene import Array, Scene

Disturbed = Literal["haptic", "image", "both"]
SEVERITIES = (1, 2, 3, 4, 5)
SCALES = Path(__file__).with_name("severities.yaml")
HOMES = {"haptic": (traces, strokes), "image": (pixels, lenses)}


@dataclass(frozen=True)
class Perturbation:
    """One way in which recordings go wrong.

    Attributes:
        name: Of its function, and in ``severities.yaml``.
        modality: What it changes.
        unit: Of its values.
        levels: Values of severity 0 (nearly harmless) to 5.
        log: Whether the scale between levels is even in logarithms.
        axes: Number of axes that a trace must have; None for any.
        held_out: Whether it is kept from training.
        function: Dotted path of the function, of a user's; None where the package has it.
    """

    name: str
    modality: Disturbed
    unit: str
    levels: tuple[float, ...]
    log: bool = False
    axes: int | None = None
    held_out: bool = False
    function: str | None = None

    def value(self, severity: float) -> float:
        """The value, in ``unit``, of any severity from 0 to 5."""
        levels = np.array(self.levels, dtype=np.float64)
        if self.log:
            levels = np.log(levels)
        value = float(np.interp(severity, range(len(levels)), levels))
        return math.exp(value) if self.log else value

    def apply(self, recording: Array, severity: float, scene: Scene) -> Array:
        """Change a recording; severity 0 leaves it as it is.

        Args:
            recording: Trace (axes, samples) float32, or photo (height, width, 3) uint8.
            severity: 0 to 5, whole or between.
            scene: Its circumstances.

        Returns:
            A recording of the same type, not always of the same size.
        """
        if severity == 0:
            return recording
        changed = _function(self)(recording, self.value(severity), scene)
        if self.modality == "haptic":
            return np.ascontiguousarray(changed, dtype=np.float32)
        if changed.dtype != np.uint8:
            changed = np.rint(np.clip(changed, 0, 255)).astype(np.uint8)
        return np.ascontiguousarray(changed)


@cache
def perturbations() -> dict[str, Perturbation]:
    """All of them by name: of traces, of photos, of both."""
    table = cast(dict[Disturbed, dict[str, dict]], OmegaConf.to_object(OmegaConf.load(SCALES)))  # type: ignore[type-arg]
    return {
        name: Perturbation(name, modality, **{**entry, "levels": tuple(entry["levels"])})
        for modality, entries in table.items()
        for name, entry in entries.items()
    }


def read_severities(path: str | Path) -> dict[str, Perturbation]:
    """Perturbations of a user's own table, in the form of ``severities.yaml``.

    Every line also names its ``function`` by a dotted path. It takes a trace (axes, samples)
    float32 or a photo (height, width, 3) uint8, a value between two levels, and a :class:`Scene`.

    Raises:
        UserError: If the file, a line or a function cannot be used.
    """
    try:
        table: Any = OmegaConf.to_object(OmegaConf.load(Path(path).expanduser()))
        found = {
            name: Perturbation(name, modality, **{**entry, "levels": tuple(entry["levels"])})
            for modality, entries in table.items()
            for name, entry in entries.items()
        }
        for each in found.values():
            _check(each)
            _function(each)
    except Exception as error:  # a function's module may fail in any way
        said = " ".join(str(error).split()).rstrip(".")
        raise UserError(
            f"stability.severities={path} cannot be used: {said}; write "
            "{image: {NAME: {function: my_ext.NAME, unit: TEXT, levels: [six numbers]}}}."
        ) from error
    return found


def _check(own: Perturbation) -> None:
    if own.modality not in HOMES:
        raise ValueError(f"{own.name} is of {own.modality}, not of haptic or image")
    if own.name in perturbations():
        raise ValueError(f"{own.name} is the name of one of the package")
    if len(own.levels) != 1 + len(SEVERITIES) or not all(map(math.isfinite, own.levels)):
        raise ValueError(f"{own.name} has no six levels")
    if own.function is None:
        raise ValueError(f"{own.name} names no function")


def _function(own: Perturbation) -> Callable[[Array, float, Scene], Array]:
    if own.function is not None:
        return cast(Callable[[Array, float, Scene], Array], pkgutil.resolve_name(own.function))
    home = next(home for home in HOMES[own.modality] if hasattr(home, own.name))
    return cast(Callable[[Array, float, Scene], Array], getattr(home, own.name))
