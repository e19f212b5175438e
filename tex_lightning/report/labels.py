"""Place labels where there is room for them."""

from collections.abc import Sequence
from math import inf

from matplotlib.axes import Axes

from tex_lightning.report.style import Look
from tex_lightning.text import printable

SIZE = 7  # points
LONGEST = 44  # characters of a name


def brief(name: str, longest: int = LONGEST) -> str:
    """A name as a figure has it, in at most about so many characters: without its middle."""
    name, half = printable(name), longest // 2
    return name if len(name) <= longest else f"{name[:half]}…{name[-half:]}"


def spaced(
    places: Sequence[float], gap: float, least: float = -inf, most: float = inf
) -> list[float]:
    """Places at least ``gap`` apart, in the same order, each group of close ones about its mean.

    Args:
        places: Along an axis, in any order.
        gap: In the unit of the places.
        least: Where the axis begins.
        most: Where it ends; groups are moved to lie between both, if there is room.
    """

    def centred(members: list[int]) -> float:
        half = gap * (len(members) - 1) / 2
        mean = sum(places[each] for each in members) / len(members)
        return min(max(mean, least + half), most - half)

    order = sorted(range(len(places)), key=lambda index: places[index])
    groups: list[tuple[float, list[int]]] = []  # the centre of each, and its members
    for index in order:
        members = [index]
        centre = centred(members)
        while groups and centre - groups[-1][0] < gap * (len(members) + len(groups[-1][1])) / 2:
            members = groups.pop()[1] + members
            centre = centred(members)
        groups.append((centre, members))
    found = list(places)
    for centre, members in groups:
        for number, index in enumerate(members):
            found[index] = centre + gap * (number - (len(members) - 1) / 2)
    return found


def name_lines(axes: Axes, ends: Sequence[tuple[str, float, Look]], height: float) -> None:
    """Names to the right of the axes, each led to by the end of its line.

    Args:
        axes: With final limits.
        ends: Of each line name, height in the unit of the axis, and look.
        height: Height of the axes in inches, or a little more.
    """
    low, high = axes.get_ylim()
    gap = 1.5 * SIZE / 72 / height * (high - low)
    for (name, end, look), place in zip(
        ends, spaced([end for _, end, _ in ends], gap), strict=True
    ):
        axes.annotate(
            brief(name), (1, end), (1.04, place), xycoords=("axes fraction", "data"),
            textcoords=("axes fraction", "data"), va="center", fontsize=SIZE,
            annotation_clip=False,
            arrowprops={"arrowstyle": "-", "color": look.colour, "linewidth": 0.5, "shrinkA": 0,
                        "shrinkB": 0},
        )  # fmt: skip
