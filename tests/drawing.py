"""Figures of commands, each kind of which is drawn once a process.

To lay out and draw takes a tenth of the time of the tests that run commands, and most of them draw
the same few kinds. Tests of what figures show call the functions that draw them, and no command.
"""

from typing import Any

import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

DRAWN = set[tuple[str, ...]]()  # texts beside the axes of the figures that were


def draw_once(patch: pytest.MonkeyPatch) -> None:
    """Write figures whose axes are called as those of an earlier one as empty pictures."""
    save = Figure.savefig

    def once_saved(figure: Figure, file: Any, **how: Any) -> None:
        kind = tuple(
            text for axes in figure.axes for text in (axes.get_xlabel(), axes.get_ylabel())
        )
        if kind not in DRAWN:
            save(figure, file, **how)
            DRAWN.add(kind)
            return
        size = FigureCanvasAgg(figure).get_width_height()
        Image.new("RGB", size, "white").save(file, format=how["format"])

    patch.setattr(Figure, "savefig", once_saved)
