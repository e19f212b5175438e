"""The style of all figures, and a colour for each system, the same in every chart.

The colours are those of Okabe and Ito (https://jfly.uni-koeln.de/color/). Their yellow cannot be
seen on white, and their black is kept for what is no system: two of Tol's take their place.
"""

import re
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import wraps
from typing import Any, ParamSpec, TypeVar
from zlib import crc32

from matplotlib import rc_context
from matplotlib.colors import to_hex, to_rgb

from tex_lightning.text import printable

FAMILIES = {"haptic": "#0072b2", "visual": "#009e73", "sound": "#56b4e9", "fusion": "#cc79a7"}
OTHERS = ("#e69f00", "#d55e00", "#332288", "#661100")
DARKER = 0.5  # of a family's colour, for every other variant
MARKERS = "osD^vPX<"
GUIDE = "#999999"  # of lines that belong to no system
STYLE: Any = {
    "font.family": "DejaVu Sans",  # comes with Matplotlib, so that every machine draws alike
    "font.size": 8,
    "text.parse_math": False,  # a dollar sign in a name is one
    "figure.dpi": 120,
    "axes.titlesize": 9,
    "axes.labelsize": 8,
    "figure.titlesize": 10,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "legend.fontsize": 7,
    "axes.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "lines.markersize": 4,
    "grid.alpha": 0.3,
    "grid.linewidth": 0.5,
}
P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class Look:
    """Colour and marker of a system.

    Attributes:
        colour: As ``#rrggbb``.
        marker: Matplotlib's, told apart without the colour.
    """

    colour: str
    marker: str


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Let a function draw in this style; the caller's own settings of Matplotlib do not change."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        with rc_context(STYLE):
            return draw(*args, **kwargs)

    return drawn


def looks(names: Iterable[str]) -> dict[str, Look]:
    """Colours and markers of the systems of one chart, by name.

    HapticNet, VisualNet, the sound network and FusionNet have a colour each, in which variants
    (``haptic_bands``, ``fusion (RUN)``, ``haptic+visual``) have that or a darker one. Any other
    name takes one of the other colours. Which one depends on the name alone, except that a colour
    is taken twice only when all are; then the markers differ.

    Args:
        names: Names of systems or networks, in any order, which is kept.
    """
    names = list(names)
    found: dict[str, Look] = {}
    used: Counter[str] = Counter()
    for name in sorted(set(names), key=lambda name: (not _is_plain(name), name)):
        colours = _colours(name)
        first = 0 if _is_plain(name) else crc32(name.encode()) % len(colours)
        colour = min(colours[first:] + colours[:first], key=used.__getitem__)
        place = _hues().index(colours[0]) + colours.index(colour) + used[colour]
        found[name] = Look(colour, MARKERS[place % len(MARKERS)])
        used[colour] += 1
    return {name: found[name] for name in names}


def colour_of(name: str) -> str:
    """The colour of a system that is alone in its chart."""
    return looks([name])[name].colour


def _family(name: str) -> str:
    """The first word of a name without ``net``; several senses are fused."""
    word = re.split(r"[ (]", name.lower())[0]
    return "fusion" if "+" in word else word.partition("_")[0].removesuffix("net")


def _is_plain(name: str) -> bool:
    return name.lower().removesuffix("net") in FAMILIES


def _hues() -> list[str]:
    return [*FAMILIES.values(), *OTHERS]


def _colours(name: str) -> list[str]:
    """Colours that a name may take."""
    hue = FAMILIES.get(_family(name))
    if hue is None:
        return list(OTHERS)
    red, green, blue = (DARKER * part for part in to_rgb(hue))
    return [hue, to_hex((red, green, blue))]


LABEL_SIZE = 7  # points
MAX_NAME = 44  # characters of a name


def brief(name: str, longest: int = MAX_NAME) -> str:
    """A name as a figure has it, in at most about so many characters: without its middle."""
    name, half = printable(name), longest // 2
    return name if len(name) <= longest else f"{name[:half]}…{name[-half:]}"
