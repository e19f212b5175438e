"""A specimen: one material made up once, for any number of photos and strokes."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from tex_lightning.synthetic.materials import Material, Skin
from tex_lightning.synthetic.relief import (
    PITCH,
    TILE,
    Field,
    make_micro,
    make_relief,
    shaped_noise,
    smooth,
)


@dataclass(frozen=True, eq=False)
class Specimen:
    """The tiles of one material, each made when it is first asked for.

    Photos and traces need the relief and each half of the rest; all of it takes about a fifth of a
    second and 40 MB.

    Attributes:
        material: What it is made of.
    """

    material: Material

    @cached_property
    def height(self) -> Field:
        """Relief in mm, shape (``TILE``, ``TILE``).

        All below but ``micro`` and the colours of ``albedo`` is derived from it.
        """
        return make_relief(self.material.relief)

    @cached_property
    def slope_x(self) -> Field:
        """Derivative of the height along x, same shape, without unit."""
        return _slope(self.height, axis=1)

    @cached_property
    def slope_y(self) -> Field:
        """Derivative along y."""
        return _slope(self.height, axis=0)

    @cached_property
    def occlusion(self) -> Field:
        """Diffuse light at every point: 1 on a plain, less in valleys, to 1.22 on a ridge."""
        wavelength = self.material.relief.wavelength
        # Sky visibility is estimated from how far a point lies below its surroundings.
        sunk = (smooth(self.height, wavelength / 2) - self.height) / np.float32(wavelength)
        seen: Field = np.exp(-6 * np.maximum(sunk, 0) - 2 * np.clip(sunk, -0.1, 0))
        return seen

    @cached_property
    def albedo(self) -> Field:
        """Reflectance, shape (``TILE``, ``TILE``, 3), linear red, green, blue."""
        skin = self.material.skin
        rng = np.random.default_rng([skin.seed, 2])
        weight = _pattern(self.height, skin, rng)[..., None]
        mottle = shaped_noise(rng, TILE, PITCH, lambda _, __, k: np.exp(-1.5 * np.log(0.2 + k)))
        ground = np.asarray(skin.colour, np.float32)
        accent = np.asarray(skin.accent, np.float32)
        mixed = ground + weight * (accent - ground)
        return np.clip(mixed * (1 + np.float32(0.05) * mottle[..., None]), 0, 1)

    @cached_property
    def contact_height(self) -> Field:
        """Relief as the tip follows it, in mm: averaged over the contact patch."""
        # The softer the surface, the wider the patch.
        radius = np.clip(0.12 * (1e6 / self.material.body.stiffness) ** 0.25, 0.12, 0.4)
        return smooth(self.height, float(radius))

    @cached_property
    def micro(self) -> Field:
        """Fine roughness in mm, shape (``MICRO_TILE``, ``MICRO_TILE``)."""
        return make_micro(self.material.body)


def _slope(height: Field, axis: int) -> Field:
    slope: Field = (np.roll(height, -1, axis) - np.roll(height, 1, axis)) / np.float32(2 * PITCH)
    return slope


def _pattern(height: Field, skin: Skin, rng: np.random.Generator) -> Field:
    """Give the share of the accent colour at every point, in [0, 1]."""
    count = max(2, round(TILE * PITCH / skin.pattern_size))
    line = np.arange(TILE, dtype=np.float32) * np.float32(2 * np.pi * count / TILE)
    rows, columns = np.meshgrid(line, line, indexing="ij")
    if skin.pattern == "valleys":
        return _step(-height / height.std() - 0.3, 4)
    if skin.pattern == "stripes":
        return _step(np.sin(rows + columns), 6)
    if skin.pattern == "dots":
        return _step(np.cos(rows) + np.cos(columns) - 0.7, 5)
    if skin.pattern == "speckle":
        size = skin.pattern_size / 8
        grain = shaped_noise(rng, TILE, PITCH, lambda _, __, k: np.exp(-((3 * size * k) ** 2)))
        return _step(grain - 0.8, 5)
    return np.zeros_like(height)


def _step(level: Field, sharpness: float) -> Field:
    share: Field = 0.5 + 0.5 * np.tanh(np.float32(sharpness) * level)
    return share
