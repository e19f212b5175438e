"""One benchmark: measured, and kept in a file with what it was measured on."""

import json
import time
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any

import torch

from tex_lightning.core.environment import environment
from tex_lightning.core.files import write_text
from tex_lightning.errors import UserError

RESULTS = Path(__file__).parents[1] / "outputs" / "benchmarks"


def run_one(name: str, options: Mapping[str, str] = MappingProxyType({})) -> dict[str, Any]:
    """Measure one benchmark and write ``outputs/benchmarks/NAME.json``.

    What cannot be measured here, for want of data or of a library, says so under ``not_run``.
    """
    begin = time.perf_counter()
    try:
        figures = {"figures": import_module(f"benchmarks.{name}").measure(**options)}
    except UserError as error:
        figures = {"not_run": str(error)}
    result = {
        "benchmark": name,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": time.perf_counter() - begin,
        "environment": environment(torch.device("cpu")),
        **figures,
    }
    write_text(RESULTS / f"{name}.json", json.dumps(result, indent=1) + "\n")
    return result
