"""A specimen: the tiles of one material, made up once for any number of photos and strokes.

Tiles are height fields in millimetres on a grid of known pitch, and what is derived from them.
Every tile wraps around at its edges, so a photo and a stroke of any size can be laid over it. Axis
0 is y (downwards in a photo) and axis 1 is x; grooves and fibres run along y.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import fft  # in float32 twice as fast as NumPy's

from tex_lightning.synthetic.materials import Material, ReliefSpec, Skin

Field = NDArray[np.float32]

TILE = 1024  # grid points along a side
PITCH = 0.06  # mm between grid points of the relief, and of photo pixels at arm's length
MICRO_TILE = 512
MICRO_PITCH = 0.016  # mm; five points on the shortest wavelength of the fine roughness


def make_relief(spec: ReliefSpec) -> Field:
    """Build the height field of a material, shape (``TILE``, ``TILE``).

    Heights are in mm, of mean zero and root mean square ``spec.depth``.
    """
    rng = np.random.default_rng([spec.seed, 0])
    shape = _SHAPES[spec.family](rng, spec.wavelength)
    grain = shaped_noise(rng, TILE, PITCH, lambda _, __, k: np.exp(-0.5 * (0.4 * k) ** 2))
    return _scaled(shape + 0.08 * grain, spec.depth)


def smooth(tile: Field, sigma: float) -> Field:
    """Average a relief tile over a Gaussian of deviation ``sigma`` mm, across its edges."""
    _, _, k = _frequencies(TILE, PITCH)
    spectrum = fft.rfft2(tile) * np.exp(-0.5 * (2 * np.pi * sigma * k) ** 2)
    return fft.irfft2(spectrum, tile.shape).astype(np.float32)


def shaped_noise(
    rng: np.random.Generator,
    points: int,
    pitch: float,
    gain: Callable[[Field, Field, Field], Field],
) -> Field:
    """Filter white noise into a periodic field of zero mean and unit variance.

    Args:
        rng: Source of the noise.
        points: Grid points along a side.
        pitch: Grid pitch in mm.
        gain: Amplitude from the spatial frequencies (x, y, radial), in cycles per mm.

    Returns:
        Field of shape (points, points).
    """
    amplitude = gain(*_frequencies(points, pitch))
    white = rng.standard_normal((points, points), dtype=np.float32)
    return _scaled(fft.irfft2(fft.rfft2(white) * amplitude, white.shape), 1.0)


def _frequencies(points: int, pitch: float) -> tuple[Field, Field, Field]:
    x = np.fft.rfftfreq(points, pitch).astype(np.float32)[None, :]
    y = np.fft.fftfreq(points, pitch).astype(np.float32)[:, None]
    return x, y, np.hypot(x, y)


def _scaled(field: NDArray[np.floating], deviation: float) -> Field:
    centred = field - field.mean()
    return np.asarray(centred * (deviation / centred.std()), np.float32)


def _band(
    rng: np.random.Generator, points: int, pitch: float, wavelength: float, width: float
) -> Field:
    """Make isotropic noise around one wavelength; ``width`` is in logarithms of frequency."""

    def gain(_: Field, __: Field, k: Field) -> Field:
        distance = np.log(np.maximum(k, 1e-6) * wavelength) / width
        return (np.exp(-0.5 * distance**2) / np.maximum(k, 1e-6)).astype(np.float32)

    return shaped_noise(rng, points, pitch, gain)


def _cells(rng: np.random.Generator, wavelength: float, jitter: float) -> tuple[Field, Field]:
    """Count features along x and y from 0, with hand-made irregularity of ``jitter`` features.

    An even, whole number of features fits the tile, so that patterns wrap around.
    """
    count = 2 * max(1, round(TILE * PITCH / wavelength / 2))
    line = np.arange(TILE, dtype=np.float32) * (count / TILE)
    drift = [_band(rng, TILE, PITCH, 8 * wavelength, width=0.5) for _ in range(2)]
    return line[None, :] + jitter * drift[0], line[:, None] + jitter * drift[1]


def _grooved(rng: np.random.Generator, wavelength: float) -> Field:
    x, _ = _cells(rng, wavelength, 0.06)
    return np.tanh(2.5 * np.sin(2 * np.pi * x))


def _woven(rng: np.random.Generator, wavelength: float) -> Field:
    x, y = _cells(rng, wavelength, 0.06)
    across, along = np.abs(np.sin(np.pi * x)), np.abs(np.sin(np.pi * y))
    warp_on_top = (np.floor(x) + np.floor(y)) % 2 == 0
    return np.where(warp_on_top, np.sqrt(across) * along, across * np.sqrt(along))


def _mesh(rng: np.random.Generator, wavelength: float) -> Field:
    x, y = _cells(rng, wavelength, 0.03)
    return np.tanh(3 * np.maximum(np.cos(2 * np.pi * x), np.cos(2 * np.pi * y)) - 1.8)


def _domes(rng: np.random.Generator, spacing: float, radius: float) -> Field:
    """Lay hemispheres of ``radius`` mm around a jittered lattice of ``spacing`` mm, in [0, 1]."""
    count = round(TILE * PITCH / spacing)
    lattice = np.stack(np.meshgrid(*[np.arange(count)] * 2), axis=-1).reshape(-1, 2)
    centres = (lattice + 0.5 * rng.uniform(-1, 1, lattice.shape)) * (TILE / count)
    column, row = np.rint(centres).astype(int).T
    steps = np.arange(-int(radius / PITCH), int(radius / PITCH) + 1)
    heights = 1 - np.hypot(steps, steps[:, None]) ** 2 * (PITCH / radius) ** 2
    domes = np.zeros((TILE, TILE), np.float32)
    for place in np.argsort(heights, axis=None)[np.sum(heights <= 0) :]:  # the highest stays
        down, right = np.unravel_index(place, heights.shape)
        domes[(row + steps[down]) % TILE, (column + steps[right]) % TILE] = heights[down, right]
    return np.sqrt(domes)


def _fibrous(rng: np.random.Generator, wavelength: float) -> Field:
    def gain(x: Field, y: Field, _: Field) -> Field:
        across = ((x * wavelength - 1) / 0.5) ** 2
        along = (15 * wavelength * y) ** 2
        return np.exp(-0.5 * (across + along))

    return shaped_noise(rng, TILE, PITCH, gain)


def _rough(rng: np.random.Generator, wavelength: float) -> Field:
    def gain(_: Field, __: Field, k: Field) -> Field:
        return (1 + (2 * k * wavelength) ** 2) ** -0.9

    return shaped_noise(rng, TILE, PITCH, gain)


def _creased(rng: np.random.Generator, wavelength: float) -> Field:
    # Zero crossings of a band of noise lie half a wavelength apart and meander like creases.
    noise = _band(rng, TILE, PITCH, 2 * wavelength, width=0.3)
    return np.sqrt(np.abs(noise))


_SHAPES: dict[str, Callable[[np.random.Generator, float], Field]] = {
    "grooved": _grooved,
    "woven": _woven,
    "mesh": _mesh,
    "granular": lambda rng, wavelength: _domes(rng, wavelength, 0.75 * wavelength),
    "porous": lambda rng, wavelength: -_domes(rng, wavelength, 0.38 * wavelength),
    "fibrous": _fibrous,
    "rough": _rough,
    "creased": _creased,
}


@dataclass(frozen=True, eq=False)
class Specimen:
    """The tiles of one material, each made when it is first asked for.

    Photos and traces need the relief and each half of the rest; all of it takes about a fifth of a
    second and 40 MB.
    """

    material: Material

    @cached_property
    def height(self) -> Field:
        """Relief in mm, shape (``TILE``, ``TILE``).

        All below but ``micro`` and the colours of ``albedo`` is derived from it.
        """
        return make_relief(self.material.relief)

    @cached_property
    def normals(self) -> Field:
        """Parts of the unit normals along x, y and upwards, shape (3, ``TILE``, ``TILE``)."""
        x, y = -_slope(self.height, axis=1), -_slope(self.height, axis=0)
        normals = np.stack((x, y, np.ones_like(x)))
        normals /= np.sqrt(np.sum(normals**2, axis=0))
        return normals

    @cached_property
    def occlusion(self) -> Field:
        """Diffuse light at every point: 1 on a plain, less in valleys, to 1.22 on a ridge."""
        wavelength = self.material.relief.wavelength
        # Sky visibility is estimated from how far a point lies below its surroundings.
        sunk = (smooth(self.height, wavelength / 2) - self.height) / np.float32(wavelength)
        return np.exp(-6 * np.maximum(sunk, 0) - 2 * np.clip(sunk, -0.1, 0))

    @cached_property
    def albedo(self) -> Field:
        """Reflectance, shape (3, ``TILE``, ``TILE``), linear red, green, blue."""
        skin = self.material.skin
        rng = np.random.default_rng([skin.seed, 2])
        weight = _pattern(self.height, skin, rng)
        mottle = 1 + 0.05 * shaped_noise(rng, TILE, PITCH, lambda _, __, k: (0.2 + k) ** -1.5)
        colours = np.array([skin.colour, skin.accent], np.float32).T
        mixed = [(ground + weight * (accent - ground)) * mottle for ground, accent in colours]
        return np.clip(mixed, 0, 1)

    @cached_property
    def contact_height(self) -> Field:
        """Relief as the tip follows it, in mm: averaged over the contact patch."""
        # The softer the surface, the wider the patch.
        radius = np.clip(0.12 * (1e6 / self.material.body.stiffness) ** 0.25, 0.12, 0.4)
        return smooth(self.height, float(radius))

    @cached_property
    def micro(self) -> Field:
        """Fine roughness in mm, which photos leave out, shape (``MICRO_TILE``, ``MICRO_TILE``)."""
        body = self.material.body
        rng = np.random.default_rng([body.seed, 1])
        noise = _band(rng, MICRO_TILE, MICRO_PITCH, body.micro_wavelength, width=0.35)
        return _scaled(noise, body.micro_depth)


def _slope(height: Field, axis: int) -> Field:
    return (np.roll(height, -1, axis) - np.roll(height, 1, axis)) / np.float32(2 * PITCH)


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
    return 0.5 + 0.5 * np.tanh(np.float32(sharpness) * level)
