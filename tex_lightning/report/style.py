"""The style of all figures: colours and markers.

The colours are those of Okabe and Ito (https://jfly.uni-koeln.de/color/), but for yellow, which
cannot be seen on white, and black, which no system has: two of Tol's replace them.
"""

import logging
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from itertools import zip_longest
from typing import Any, NamedTuple, ParamSpec, TypeVar

from matplotlib import rc_context
from matplotlib.font_manager import get_font_names

from tex_lightning.text import printable

COLOURS = (
    "#0072b2", "#009e73", "#cc79a7", "#e69f00", "#d55e00", "#56b4e9", "#332288", "#661100",
)  # fmt: skip
MARKERS = "osD^vPX<"
GUIDE = "#999999"  # of lines that belong to no system
# Of systems that have them, for what the first has no signs of: Chinese, Japanese, Korean.
OTHER_FONTS = (
    "Noto Sans CJK SC", "Source Han Sans SC", "WenQuanYi Zen Hei", "WenQuanYi Micro Hei",
    "Microsoft YaHei", "SimHei", "PingFang SC", "Hiragino Sans GB", "Hiragino Sans", "Yu Gothic",
    "Malgun Gothic", "Apple SD Gothic Neo", "Droid Sans Fallback", "Arial Unicode MS",
)  # fmt: skip
STYLE: Any = {
    # the first comes with Matplotlib, so that every machine draws alike
    "font.family": [
        "DejaVu Sans",
        *sorted({*OTHER_FONTS} & {*get_font_names()}, key=OTHER_FONTS.index),
    ],
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
FONTS = logging.getLogger("matplotlib.font_manager")
MAX_NAME = 44  # characters of a name
P = ParamSpec("P")
T = TypeVar("T")


class Look(NamedTuple):
    """Colour of a system as ``#rrggbb``, and a marker that distinguishes it without colour."""

    colour: str
    marker: str


def styled(draw: Callable[P, T]) -> Callable[P, T]:
    """Wrap a function to draw in this style, without changing the caller's Matplotlib settings."""

    @wraps(draw)
    def drawn(*args: P.args, **kwargs: P.kwargs) -> T:
        level = FONTS.level
        FONTS.setLevel(logging.ERROR)  # it warns of fonts without the usual weight
        try:
            with rc_context(STYLE):
                return draw(*args, **kwargs)
        finally:
            FONTS.setLevel(level)

    return drawn


def looks(names: Iterable[str]) -> dict[str, Look]:
    """Return a colour and a marker for each system of one chart, by name, in order."""
    return {
        name: Look(COLOURS[row % len(COLOURS)], MARKERS[row // len(COLOURS) % len(MARKERS)])
        for row, name in enumerate(dict.fromkeys(names))
    }


def brief(name: str, longest: int = MAX_NAME) -> str:
    """Return a name as a figure has it, in at most about so many characters: without its middle."""
    name, half = printable(name), longest // 2
    return name if len(name) <= longest else f"{name[:half]}…{name[-half:]}"


def briefs(names: Sequence[str], longest: int) -> list[str]:
    """Return brief names; those that are alike then go on from where they begin to differ."""
    alike, half = defaultdict(list), longest // 2
    for name in names:
        alike[brief(name, longest)].append(printable(name))
    found = []
    for name in names:
        text, others = printable(name), alike[brief(name, longest)]
        begin = min((_differs(text, other) for other in others if other != text), default=None)
        cut = None if begin is None else f"{text[:half]}…{text[begin : begin + half]}"
        found.append(cut or brief(name, longest))
    return found


def _differs(one: str, other: str) -> int:
    """Return where two texts begin to differ."""
    pairs = enumerate(zip_longest(one, other))
    return next(place for place, (left, right) in pairs if left != right)
