"""A table of results out of run folders: ``python docs/result_table.py RUN...`` prints it.

Each RUN is the folder of a ``task=fit``, ``crossval`` or ``evaluate``, whose ``results.json`` says
what was asked for, and on which commit and machine. ``--untimed`` leaves out times, for runs that
shared their machine with others.
"""

import json
import sys
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

from tex_lightning.report.table import markdown

HEADINGS = (
    "run", "network", "data", "votes", "95 % interval", "calibration error", "ms", "fit s a fold",
    "parameters", "M multiply-accumulates", "commit", "machine",
)  # fmt: skip
# What every run of a data set is given, and what changes no figure.
LEFT_OUT = (
    "task=", "data=", "data.root=", "data.manifest=", "data.half_scale=false", "weights=/",
    "weights=../", "data.sampling_rate=", "data.cache_dir=", "crossval.only=", "trainer.threads=",
    "hydra",
)  # fmt: skip
UNKNOWN = "not recorded"


def rows(run: Path) -> list[list[str]]:
    """A row for each network of a run."""
    results = json.loads((run / "results.json").read_text(encoding="utf-8"))
    overrides = [str(each) for each in OmegaConf.load(run / ".hydra" / "overrides.yaml")]
    settings = json.loads((run / "settings.json").read_text(encoding="utf-8"))
    source = settings.get("data.manifest") or settings.get("data.root") or settings["data.name"]
    asked = " ".join(each for each in overrides if not each.startswith(LEFT_OUT))
    begin = [f"`{asked or results['model']}`"]
    end = [_commit(results["environment"]), _machine(results["environment"])]
    return [
        [*begin, name, Path(source).stem, *_cells(network), *end]
        for name, network in results["networks"].items()
    ]


def _cells(network: dict[str, Any]) -> list[str]:
    """Figures of a network, each with its unit in the heading."""
    low, high = network["vote_ci95"]
    macs = network.get("macs_per_sample")
    return [
        f"{100 * network['vote_accuracy']:.1f} % ({network['correct']}/{network['test_samples']})",
        f"{100 * low:.1f} to {100 * high:.1f} %",
        f"{network['calibration']['ece']:.3f}",
        f"{network['latency_ms']['median']:.1f}",
        f"{network['fit_seconds'] / max(1, len(network.get('folds', []))):.1f}",
        f"{network['parameters']:,}",
        f"{macs / 1e6:,.1f}" if macs else "",
    ]


def _commit(environment: dict[str, Any]) -> str:
    return environment.get("commit") or UNKNOWN


def _machine(environment: dict[str, Any]) -> str:
    threads = environment["threads"]
    return f"{environment['cpu']}, {threads} thread{'s' if threads > 1 else ''}"


def result_table(runs: list[Path], *, timed: bool = True) -> str:
    """Rows of all runs in Markdown; a commit or machine that all share becomes a sentence."""
    lines = [row for run in runs for row in rows(run)]
    same = [place for place in (-2, -1) if len({row[place] for row in lines}) == 1]
    said = [f"{HEADINGS[place].capitalize()}: {lines[0][place]}." for place in same]
    hidden = {HEADINGS[place] for place in same} | (set() if timed else {"ms", "fit s a fold"})
    kept = [place for place, heading in enumerate(HEADINGS) if heading not in hidden]
    table = markdown(
        [HEADINGS[place] for place in kept], [[row[place] for place in kept] for row in lines]
    )
    return "\n".join([*table, *(["", " ".join(said)] if said else [])])


if __name__ == "__main__":
    given = [each for each in sys.argv[1:] if each != "--untimed"]
    print(result_table([Path(each) for each in given], timed=given == sys.argv[1:]))
