"""Surface material classification from acceleration traces and photos."""

import os
import re
import sys
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

if find_spec("tex_lightning_runtime") is None:  # a checkout that is not installed
    sys.path.append(str(Path(__file__).parents[1] / "runtime"))

__version__ = "0.2.0"

# Public names by their module, as the stub beside this file lists them. Most modules need PyTorch,
# which is imported when one is asked for: a mistyped command fails before.
_STUB = Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8")
_MODULES = {name: module for module, name in re.findall(r"^from (\S+) import (\w+)", _STUB, re.M)}

__all__ = [*_MODULES]

# PyTorch's threads spin while they wait for each other, and beside another busy process they wait
# for one that does not run: up to ten times as long. GNU's threads, which read the second, spin for
# a moment before they sleep: of all settings tried it loses least, idle and busy (docs/scale.md).
# OpenMP reads these once, when PyTorch is imported.
if not {"OMP_WAIT_POLICY", "GOMP_SPINCOUNT", "KMP_BLOCKTIME"} & os.environ.keys():
    os.environ |= {"OMP_WAIT_POLICY": "PASSIVE", "GOMP_SPINCOUNT": "3000"}


def __getattr__(name: str) -> object:
    """Import a public name on first use."""
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    """Return all names, also those that are not imported yet."""
    return sorted({*globals(), *__all__})
