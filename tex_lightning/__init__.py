"""Surface material classification from acceleration traces and photos."""

import os
from typing import TYPE_CHECKING

from tex_lightning.errors import UserError

if TYPE_CHECKING:
    from tex_lightning.predictor import load

__version__ = "0.1.0"

__all__ = ["UserError", "load"]

# PyTorch's threads spin while they wait for each other, and beside another busy process they wait
# for one that does not run: up to ten times as long. Sleeping costs an idle machine 5 to 20 %
# (`python -m benchmarks threads`). OpenMP reads this once, when PyTorch is imported.
if not {"OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME"} & os.environ.keys():
    os.environ["OMP_WAIT_POLICY"] = "PASSIVE"


def __getattr__(name: str) -> object:
    """Import what needs PyTorch when it is asked for: a mistyped command is refused before."""
    if name == "load":
        from tex_lightning.predictor import load

        return load
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
