"""Run benchmarks, each in a process of its own, keep their figures and print one table."""

import pkgutil
import sys
from collections.abc import Collection
from concurrent.futures import ProcessPoolExecutor
from importlib import import_module
from inspect import signature
from multiprocessing import get_context
from typing import Any

from rich.table import Table

import benchmarks
from benchmarks._run import RESULTS, run_one
from tex_lightning.config import flatten
from tex_lightning.core.console import console

FOREMOST = "ratio"
LONG = ("accuracy", "adaptation", "device", "digests", "drifting", "faults", "fusion", "hostile",
        "mutants", "mutations", "nodes", "shapes", "shifts", "slurm", "unknown")  # fmt: skip


def names() -> list[str]:
    """Every benchmark of the folder."""
    return [found.name for found in pkgutil.iter_modules(benchmarks.__path__) if _is_public(found)]


def _is_public(found: pkgutil.ModuleInfo) -> bool:
    return not found.name.startswith("_")


def takes(name: str) -> Collection[str]:
    """Options of a benchmark."""
    return signature(import_module(f"benchmarks.{name}").measure).parameters


def rows(result: dict[str, Any]) -> list[tuple[str, str]]:
    """Names and values of a result's figures, ratios first."""
    if "not_run" in result:
        return [("not run", result["not_run"])]
    flat = {
        key: value
        for key, value in flatten(result["figures"]).items()
        if isinstance(value, bool | int | float | str)
    }
    ordered = sorted(flat, key=lambda key: not key.endswith(FOREMOST))
    return [(key, _shown(flat[key])) for key in ordered]


def _shown(value: float | str) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def main(arguments: list[str]) -> int:
    """Run the benchmarks named, or all but the long ones; ``--help`` says what each does.

    ``--KEY=VALUE`` is for those that have such an option. The exit status is 2 for a name that
    there is not, or an option that none of the named has.
    """
    given = [item.removeprefix("--").partition("=") for item in arguments if item.startswith("--")]
    options = {key: value for key, _, value in given}
    chosen = [item for item in arguments if not item.startswith("--")]
    unknown = [name for name in chosen if name not in names()]
    if unknown:
        print(
            f"Error: There is no benchmark {', '.join(unknown)}; choose from {', '.join(names())}."
        )
        return 2
    if "help" in options:
        for name in chosen or names():
            print(f"{name}\n\n{import_module(f'benchmarks.{name}').__doc__}")
        return 0
    chosen = chosen or [each for each in names() if each not in LONG]
    if unread := [key for key in options if not any(key in takes(name) for name in chosen)]:
        print(f"Error: {', '.join(chosen)} takes no option --{unread[0]}; see --help.")
        return 2
    table = Table(title="benchmarks")
    for heading in ("benchmark", "figure"):
        table.add_column(heading)
    table.add_column("value", justify="right")
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        for name in chosen:
            own = {key: value for key, value in options.items() if key in takes(name)}
            found = pool.submit(run_one, name, own).result()
            for place, (key, value) in enumerate(rows(found)):
                table.add_row(name if place == 0 else "", key, value)
            table.add_section()
    console.print(table)
    console.print(f"Results in {RESULTS}", soft_wrap=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
