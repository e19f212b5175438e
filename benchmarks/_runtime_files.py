"""Files that the small runtime reads, too: it refuses a damaged one or agrees with the package."""

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks._seeds import AXES, FORMATS, Array, Format, read_pixels, read_signal
from tex_lightning.errors import UserError
from tex_lightning_runtime.recordings import decode

TRACE = {
    "what": "trace", "medium": "signal", "axes": [1, 3], "rate": 10_000.0, "file_rate": 10_000.0,
    "channel": None, "limits": {},
}  # fmt: skip
PHOTO = {"what": "photo", "medium": "photo", "least": 1, "half_scale": True, "limits": {}}
SAYS = ("The trace", "The photo", "A rate of")  # of what is wrong with numbers, not with a file


def read_twice(path: Path, sense: dict[str, Any]) -> list[Array]:
    """What both readers make of a file.

    Raises:
        AssertionError: If they differ, or only the runtime accepts it.
        tex_lightning_runtime.UserError: If the runtime refuses it.
    """
    found = decode(path, sense).content
    try:
        (expected,) = read_signal(path) if sense is TRACE else read_pixels(path)
    except UserError as error:
        raise AssertionError(f"only the runtime accepts it: {error}") from error
    np.testing.assert_array_equal(found, expected, strict=True)
    return [found]


def _table(path: Path, head: str, mark: str) -> None:
    np.savetxt(path, AXES.T, "%.9g", mark, header=head, comments="")


SIGNALS = {
    **{name: FORMATS[name] for name in ("wav", "wav float, 3 axes", "flac", "npy", "txt")},
    "csv": Format("a.csv", partial(_table, head="x,y,z", mark=","), read_signal, text=True),
    "csv;": Format("a.csv", partial(_table, head="#x;y;z", mark=";"), read_signal, text=True),
}
PHOTOS = {name: FORMATS[name] for name in ("jpeg", "png", "webp", "bmp")}

RUNTIME = {
    f"runtime, {name}": replace(kind, read=partial(read_twice, sense=sense), says=SAYS, weight=2)
    for kinds, sense in ((SIGNALS, TRACE), (PHOTOS, PHOTO))
    for name, kind in kinds.items()
}
