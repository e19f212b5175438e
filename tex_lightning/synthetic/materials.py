"""Materials of the synthetic surfaces: what camera, tool and microphone meet at one class.

A material has four parts. The ``ReliefSpec`` is the shape of the surface, met by every sense. The
``Skin`` is what only the camera sees. The ``Body`` shakes the tool, and the microphone hears of it
what the ``Voice``, which only it meets, lets through. Twins reproduce the confusions of single
modalities (paper, section IV, confusion matrices). In every block of six classes

- the first two look alike: a plaster and a rubber cast of one mould on one board,
- the next two feel alike: one mould, two coats of paint, on opposite boards,
- the last two sound nearly alike: different in relief, body and skin, but on soft mats under the
  same loose foil, whose rustle drowns the rest.

No material imitates a real one, and the names say so: ``S001_grooved_stiff_red``.
"""

import colorsys
from dataclasses import dataclass

import numpy as np

FAMILIES = (
    "grooved", "granular", "woven", "fibrous", "mesh", "porous", "rough", "creased",
)  # fmt: skip
PATTERNS = ("plain", "valleys", "stripes", "speckle", "dots")
BLOCK = 6
_KINDS = 4  # moulds in a block: look-alikes share one, feel-alikes share one, two stand alone
_KIND_OF_SLOT = (0, 0, 1, 1, 2, 3)
_LOOK_ALIKE, _FEEL_ALIKE = 1, 3  # slots holding the second of a pair
_BOARDS = 3  # each pair has its own; the two that feel alike lie on opposite ones
_FOIL = _BOARDS - 1  # board of the pair that sounds alike
_STIFFNESS = 1.2e4, 1.0e6  # N/m, of the softest and the stiffest body


@dataclass(frozen=True)
class ReliefSpec:
    """Height field, common to both senses.

    Attributes:
        family: One of ``FAMILIES``.
        wavelength: Typical distance between neighbouring features, in mm (0.8 to 4).
        depth: Root mean square height, in mm.
        seed: Seed of the random part of the shape.
    """

    family: str
    wavelength: float
    depth: float
    seed: int


@dataclass(frozen=True)
class Body:
    """What only the tool feels.

    Attributes:
        stiffness: Normal contact stiffness at a force of 1 N, in N/m.
        damping: Damping ratio of the contact.
        friction: Coefficient of kinetic friction.
        stick: Drop of the friction coefficient at each slip.
        stick_length: Distance from one slip to the next, in mm.
        micro_wavelength: Typical wavelength of the fine roughness, in mm (0.08 to 0.35). Photos
            leave it out: it stands for roughness at and below the width of two of their pixels.
        micro_depth: Root mean square height of the fine roughness, in mm.
        seed: Seed of the fine roughness.
    """

    stiffness: float
    damping: float
    friction: float
    stick: float
    stick_length: float
    micro_wavelength: float
    micro_depth: float
    seed: int


@dataclass(frozen=True)
class Skin:
    """What only the camera sees; colours are linear red, green and blue reflectances in [0, 1].

    Attributes:
        colour: Ground colour.
        accent: Colour of the pattern.
        pattern: One of ``PATTERNS``.
        pattern_size: Typical size of the pattern, in mm.
        gloss: Strength of the specular highlight.
        shininess: Exponent of the highlight; larger is sharper.
        seed: Seed of the random part of the pattern.
    """

    colour: tuple[float, float, float]
    accent: tuple[float, float, float]
    pattern: str
    pattern_size: float
    gloss: float
    shininess: float
    seed: int


@dataclass(frozen=True)
class Voice:
    """What only the microphone hears: the board that a specimen is fixed to.

    Attributes:
        pitch: Frequency of the board's lowest ringing, in Hz.
        quality: Quality factor of the ringing; a larger one rings longer and narrower.
        loudness: Factor on the sound of the contact.
        rustle: Loudness of a loose foil; 0 without one.
    """

    pitch: float
    quality: float
    loudness: float
    rustle: float


@dataclass(frozen=True)
class Material:
    """One class of surface."""

    name: str
    relief: ReliefSpec
    body: Body
    skin: Skin
    voice: Voice


def make_materials(classes: int, seed: int) -> list[Material]:
    """Make the materials of a data set, in class order, which is also the order of their names.

    Class ``i`` depends on ``i`` and ``seed`` only: a smaller set begins a larger one. The
    parameters follow a low-discrepancy sequence, so classes keep their distance by construction
    instead of by luck.

    Args:
        classes: Number of classes.
        seed: Seed of the whole data set, not negative.
    """
    return [_make_material(index, seed) for index in range(classes)]


def _make_material(index: int, seed: int) -> Material:
    block, slot = divmod(index, BLOCK)
    kind = block * _KINDS + _KIND_OF_SLOT[slot]
    relief = _make_relief(kind, seed)
    body = _make_body(kind, seed, opposite=slot == _LOOK_ALIKE)
    skin = _make_skin(kind, seed, opposite=slot == _FEEL_ALIKE)
    voice = _make_voice(block * _BOARDS + slot // 2, seed, opposite=slot == _FEEL_ALIKE)
    words = (f"S{index + 1:03d}", relief.family, _stiffness_word(body), _colour_word(skin))
    return Material("_".join(words), relief, body, skin, voice)


def _spread(
    kind: int, primes: tuple[int, ...], seed: int, part: int, *, opposite: bool = False
) -> list[float]:
    """Draw point ``kind`` of a seeded Richtmyer sequence, which fills the unit cube evenly.

    Each dimension steps by the square root of its prime, modulo 1. The opposite point lies half a
    turn away in every dimension: the largest distance there is.
    """
    start = np.random.default_rng([seed, part]).random(len(primes))
    point = (start + kind * np.sqrt(primes) + 0.5 * opposite) % 1.0
    return [float(value) for value in point]


def _between(low: float, high: float, position: float) -> float:
    """Interpolate geometrically, as most senses judge ratios."""
    return float(low * (high / low) ** position)


def _make_relief(kind: int, seed: int) -> ReliefSpec:
    # Every family comes back after eight kinds; the root of 3 then leaves the largest gaps.
    wavelength, depth = _spread(kind, (3, 5), seed, 0)
    size = _between(0.8, 4.0, wavelength)
    first = int(np.random.default_rng([seed, 3]).integers(len(FAMILIES)))
    return ReliefSpec(
        family=FAMILIES[(first + kind) % len(FAMILIES)],
        wavelength=size,
        # Depth grows with the wavelength so that slopes, hence shading, stay alike.
        depth=size * _between(0.025, 0.06, depth),
        seed=kind,
    )


def _make_body(kind: int, seed: int, *, opposite: bool) -> Body:
    stiffness, damping, friction, stick, length, wavelength, depth = _spread(
        kind, (2, 3, 5, 7, 11, 13, 17), seed, 1, opposite=opposite
    )
    return Body(
        stiffness=_between(*_STIFFNESS, stiffness),
        damping=_between(0.1, 0.4, damping),
        friction=_between(0.15, 0.8, friction),
        stick=_between(0.02, 0.5, stick),
        stick_length=_between(0.4, 4.0, length),
        micro_wavelength=_between(0.08, 0.35, wavelength),
        micro_depth=_between(0.0002, 0.0012, depth),
        seed=2 * kind + opposite,
    )


def _make_skin(kind: int, seed: int, *, opposite: bool) -> Skin:
    hue, saturation, value, pattern, contrast, gloss = _spread(
        kind, (2, 3, 5, 7, 11, 13), seed, 2, opposite=opposite
    )
    value = _between(0.25, 0.75, value)
    colour = colorsys.hsv_to_rgb(hue, 0.15 + 0.55 * saturation, value)
    accent_value = value * _between(0.3, 0.65, contrast)
    return Skin(
        colour=colour,
        accent=colorsys.hsv_to_rgb((hue + 0.1) % 1.0, 0.3, accent_value),
        pattern=PATTERNS[int(pattern * len(PATTERNS))],
        pattern_size=_between(2.0, 8.0, contrast),
        gloss=0.5 * gloss**2,
        shininess=_between(6.0, 60.0, gloss),
        seed=2 * kind + opposite,
    )


def _make_voice(board: int, seed: int, *, opposite: bool) -> Voice:
    pitch, quality, loudness = _spread(board, (2, 3, 5), seed, 4, opposite=opposite)
    foil = board % _BOARDS == _FOIL
    return Voice(
        pitch=_between(500.0, 5000.0, pitch),
        quality=_between(3.0, 40.0, quality),
        loudness=_between(0.2, 1.6, loudness) * (0.01 if foil else 1.0),
        rustle=1.0 if foil else 0.0,
    )


def _stiffness_word(body: Body) -> str:
    softest, stiffest = _STIFFNESS
    position = np.log(body.stiffness / softest) / np.log(stiffest / softest)
    return ("soft", "firm", "stiff")[min(int(3 * position), 2)]


def _colour_word(skin: Skin) -> str:
    hue, saturation, _ = colorsys.rgb_to_hsv(*skin.colour)
    if saturation < 0.25:
        return "grey"
    words = ("red", "orange", "yellow", "lime", "green", "teal",
             "cyan", "azure", "blue", "violet", "magenta", "pink")  # fmt: skip
    return words[round(12 * hue) % 12]
