"""What can be wrong with a recording that can be read, in the words of ``task=predict``."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from tex_lightning_runtime.resampling import Array

Found = tuple[list[str], bool]  # warnings, and whether nothing was measured
MEASURES = {  # by which factor they may leave the training's range, and what to do
    "level": (3.0, "check the sensor, its unit and gain"),
    "rate": (1.5, "check the rate that was given, or record as for the training"),
    "brightness": (3.0, "check lens and light"),
    "contrast": (3.0, "check lens and light"),
}
FLAT_SHARE, FINE_VALUES = 0.01, 32  # from which on a trace is clipped; fewer are coarse steps
UNIFORM, PHOTO_SIDE = 0.5, 256  # grey levels of deviation; pixels that are looked at


def trace_quality(raw: Array, trace: Array, rate: float, sense: Mapping[str, Any]) -> Found:
    """Of samples (axes, samples) before and after they were brought from ``rate``."""
    what, x = sense["what"], raw.astype(np.float64)
    low, high = x.min(axis=1, keepdims=True), x.max(axis=1, keepdims=True)
    constant = (low == high)[:, 0]
    if constant.all():
        how = "constant" if high.any() else "silent"
        return [f"The {what} is {how}, so nothing was measured; check the sensor."], True
    axes = np.flatnonzero(constant) + 1
    found = [f"Axis {axis} of the {what} is constant; check the sensor." for axis in axes]
    flat = (((x == low) | (x == high))[:, 1:] & (x[:, 1:] == x[:, :-1])).sum(axis=1)
    flat[[len(np.unique(values)) < FINE_VALUES for values in x]] = 0
    if (clipped := flat.max() / x.shape[1]) >= FLAT_SHARE:
        told = f"The {what} is clipped, {clipped:.0%} of it at its largest or smallest value; "
        found.append(f"{told}lower the sensor's gain.")
    level = np.sqrt(trace.astype(np.float64).var(axis=1).sum())
    return [*found, *_unlike(sense, level=level, rate=min(rate, sense["rate"]))], False


def photo_quality(photo: Array, sense: Mapping[str, Any]) -> Found:
    """Of pixels (height, width, 3) as they come out of the file."""
    step = max(1, min(photo.shape[:2]) // (1 + sense["half_scale"]) // PHOTO_SIDE)
    grey = (halve(photo, step) if sense["half_scale"] else photo[::step, ::step]).mean(axis=2)
    if grey.std() < UNIFORM:
        return [f"The {sense['what']} is uniform, so it shows nothing; check the camera."], True
    return _unlike(sense, brightness=grey.mean(), contrast=grey.std()), False


def halve(photo: Array, step: int = 1) -> Array:
    """Every ``step``-th row and column of the rounded means of 2x2 pixels."""
    height, width = (side // 2 for side in photo.shape[:2])
    squares = photo[: 2 * height, : 2 * width].reshape(height, 2, width, 2, 3)[::step, :, ::step]
    corners = [squares[:, row, :, column].astype(np.uint16) for row in (0, 1) for column in (0, 1)]
    return np.asarray((sum(corners[1:], corners[0]) + 2) // 4).astype(np.uint8)


def _unlike(sense: Mapping[str, Any], **measures: float) -> list[str]:
    found = []
    for name, value in measures.items():
        low, high = sense["ranges"].get(name, (0.0, np.inf))
        tolerance, remedy = MEASURES[name]
        if not low / tolerance <= value <= high * tolerance:
            told = f"The {sense['what']} has a {name} of {value:.5g} and the training had {low:.5g}"
            found.append(f"{told} to {high:.5g}; {remedy}.")
    return found
