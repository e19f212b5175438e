"""Summary of a sweep: one line per job, whatever became of it, and the pooled folds."""

import csv
import json
import logging
from pathlib import Path
from typing import Any, ClassVar

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf
from rich.table import Table

from tex_lightning.files import write_text
from tex_lightning.progress import console
from tex_lightning.report.results import wilson_interval

log = logging.getLogger(__name__)

FAILURE = "failure.json"
FOLD_KEYS = ("data.test_fold", "crossval.only")
COLUMNS = (
    "job", "overrides", "status", "network", "vote_accuracy", "ci_low", "ci_high", "correct",
    "test_samples", "fragment_accuracy", "latency_ms", "fit_seconds",
)  # fmt: skip


def note_failure(directory: Path, reason: str) -> None:
    """Leave the reason in the job's folder, for the summary and for whoever looks there."""
    log.error("%s", reason)
    write_text(directory / FAILURE, json.dumps({"error": reason}, indent=1))


class SweepSummary(Callback):
    """Print and write ``sweep.csv`` in the sweep's folder when all jobs have run."""

    failures: ClassVar[int] = 0

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401
        """Collect what the jobs left behind."""
        directory = Path(str(OmegaConf.select(config, "hydra.sweep.dir"))).resolve()
        jobs = sorted(
            (path.parent.parent for path in directory.rglob(".hydra/overrides.yaml")),
            key=lambda path: (len(path.name), path.name),
        )
        rows = [row for job in jobs for row in _rows(job, directory)]
        rows += _pooled(rows)
        SweepSummary.failures = sum(row["status"] != "done" for row in rows)
        with (directory / "sweep.csv").open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(rows)
        _print(rows, directory)


def _rows(job: Path, root: Path) -> list[dict[str, Any]]:
    overrides = " ".join(str(item) for item in OmegaConf.load(job / ".hydra/overrides.yaml"))
    start = {"job": str(job.relative_to(root)), "overrides": overrides}
    if (job / FAILURE).is_file():
        reason = json.loads((job / FAILURE).read_text(encoding="utf-8"))["error"]
        return [{**start, "status": reason}]
    results = job / "results.json"
    if not results.is_file():
        return [{**start, "status": "done" if _writes_none(overrides) else "not finished"}]
    networks = json.loads(results.read_text(encoding="utf-8"))["networks"]
    start["status"] = "done"
    return [{**start, **_row(name, network)} for name, network in networks.items()]


def _writes_none(overrides: str) -> bool:
    return any(f"task={task}" in overrides.split() for task in ("predict", "generate"))


def _row(name: str, network: dict[str, Any]) -> dict[str, Any]:
    return {
        "network": name,
        "vote_accuracy": network["vote_accuracy"],
        "ci_low": network["vote_ci95"][0],
        "ci_high": network["vote_ci95"][1],
        "correct": network["correct"],
        "test_samples": network["test_samples"],
        "fragment_accuracy": network["fragment_accuracy"],
        "latency_ms": network["latency_ms"]["median"],
        "fit_seconds": network["fit_seconds"],
    }


def _pooled(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Counts over jobs that differ in nothing but the tested fold."""
    groups: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for row in rows:
        if row["status"] == "done" and "network" in row:
            kept = [item for item in row["overrides"].split() if not item.startswith(FOLD_KEYS)]
            if len(kept) < len(row["overrides"].split()):
                groups.setdefault((" ".join(kept), row["network"]), []).append(row)
    pooled = []
    for (overrides, network), members in groups.items():
        if len(members) < 2:
            continue
        correct = sum(row["correct"] for row in members)
        count = sum(row["test_samples"] for row in members)
        low, high = wilson_interval(correct, count)
        pooled.append(
            {
                "job": f"{len(members)} folds",
                "overrides": overrides,
                "status": "done",
                "network": network,
                "vote_accuracy": correct / count,
                "ci_low": low,
                "ci_high": high,
                "correct": correct,
                "test_samples": count,
                "fit_seconds": sum(row["fit_seconds"] for row in members),
            }
        )
    return pooled


def _varying(rows: list[dict[str, Any]]) -> dict[str, str]:
    """What distinguishes each job's overrides from those that all jobs share."""
    every = [set(row["overrides"].split()) for row in rows]
    shared = set.intersection(*every) if len(every) > 1 else set()
    return {
        row["overrides"]: " ".join(item for item in row["overrides"].split() if item not in shared)
        for row in rows
    }


def _print(rows: list[dict[str, Any]], directory: Path) -> None:
    table = Table(title="sweep")
    varying = _varying([row for row in rows if not row["job"].endswith(" folds")])
    for heading in ("job", "overrides", "network", "votes", "95 % interval", "fit s"):
        table.add_column(heading)
    for row in rows:
        if "network" not in row:
            table.add_row(row["job"], varying[row["overrides"]], "", row["status"])
            continue
        table.add_row(
            row["job"],
            varying.get(row["overrides"], ""),
            row["network"],
            f"{row['vote_accuracy']:.1%} ({row['correct']}/{row['test_samples']})",
            f"{row['ci_low']:.1%} to {row['ci_high']:.1%}",
            f"{row['fit_seconds']:.0f}",
        )
    console.print(table)
    console.print(f"Summary in {directory / 'sweep.csv'}", soft_wrap=True, highlight=False)
