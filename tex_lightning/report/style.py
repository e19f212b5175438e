"""The style of all figures, and a colour for each system, the same in every chart.

The colours are those of Okabe and Ito (https://jfly.uni-koeln.de/color/). Their yellow cannot be
seen on white, and their black is kept for what is no system: two of Tol's take their place.
"""

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, NamedTuple, ParamSpec, TypeVar
from zlib import crc32

from matplotlib import rc_context

from tex_lightning.text import printable

FAMILIES = {"haptic": "#0072b2", "visual": "#009e73", "sound": "#56b4e9", "fusion": "#cc79a7"}
OTHERS = ("#e69f00", "#d55e00", "#332288", "#661100")
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
MAX_NAME = 44  # characters of a name
P = ParamSpec("P")
T = TypeVar("T")


class Look(NamedTuple):
    """Colour of a system as ``#rrggbb``, and a marker that is told apart without it."""

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
    """Colours and markers of the systems of one chart, by name, in the order given.

    Colours are those of :func:`colour_of`; systems of one colour have different markers, up to
    eight of them.
    """
    colours = {name: colour_of(name) for name in names}
    found = {}
    for name, colour in colours.items():
        alike = sorted(other for other in colours if colours[other] == colour)
        found[name] = Look(colour, MARKERS[alike.index(name) % len(MARKERS)])
    return found


def colour_of(name: str) -> str:
    """The colour of a system in every chart.

    HapticNet, VisualNet, the sound network and FusionNet have a colour each, which their variants
    (``haptic_bands``, ``fusion (RUN)``, ``haptic+visual``) share. Any other name takes one of four
    others.
    """
    word = name.lower().partition(" ")[0]
    family = "fusion" if "+" in word else word.partition("_")[0].removesuffix("net")
    return FAMILIES.get(family) or OTHERS[crc32(name.encode()) % len(OTHERS)]


def brief(name: str, longest: int = MAX_NAME) -> str:
    """A name as a figure has it, in at most about so many characters: without its middle."""
    name, half = printable(name), longest // 2
    return name if len(name) <= longest else f"{name[:half]}…{name[-half:]}"
