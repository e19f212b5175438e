"""Summary of a sweep: a line per job, failed ones included, pooled folds, means over seeds."""

import json
import logging
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from statistics import mean, stdev
from typing import Any, ClassVar

from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import SILENT
from tex_lightning.config.composition import Job
from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.core.console import NORMAL, Screen, console, say
from tex_lightning.core.files import read_record, write_rows, write_text
from tex_lightning.core.run_folder import locked_folder
from tex_lightning.data.recordings import natural_key
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.report.table import (
    FOLD_KEYS,
    TINY,
    counted,
    is_tiny,
    make_table,
    run_overrides,
    run_settings,
)

Row = dict[str, Any]

log = logging.getLogger(__name__)

FAILURE = "failure.json"
ONE_BY_ONE = "hydra._internal.core_plugins.basic_launcher.BasicLauncher"
NO_SWEEP = (
    "A sweep runs every job in one process; leave out trainer=ddp, trainer.devices and "
    "trainer.num_nodes, or run without -m."
)
COLUMNS = (
    "job", "overrides", "status", "network", "vote_accuracy", "vote_accuracy_sd", "ci_low",
    "ci_high", "correct", "test_samples", "fragment_accuracy", "latency_ms", "fit_seconds",
)  # fmt: skip
KEPT = ("vote_accuracy", "correct", "test_samples", "fragment_accuracy", "fit_seconds")


def note_failure(job: Job, reason: str) -> None:
    """Write the reason of a failure into the job's folder, for the summary and the user."""
    log.error("%s", reason)
    text = json.dumps({"error": reason, "overrides": job.overrides}, indent=1)
    write_text(job.directory / FAILURE, text)


@contextmanager
def _as_exit() -> Iterator[None]:
    """Convert a user's mistake to the command line's message."""
    try:
        yield
    except UserError as error:
        say(f"Error: {error}")
        raise SystemExit(2) from error


class SweepSummary(Callback):
    """Print and write ``sweep.csv`` in the sweep's folder when all jobs have run."""

    failures: ClassVar[int] = 0

    def __init__(self) -> None:
        self._running = ExitStack()

    def __reduce__(self) -> tuple[type["SweepSummary"], tuple[()]]:
        """Return the pickled form for the processes of a launcher, without the lock."""
        return SweepSummary, ()

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401
        """Reject settings that no job of a sweep can run with, before the first one.

        Raises:
            SystemExit: Hydra turns other exceptions of callbacks into warnings.
        """
        # its end reads checkpoints, and a launcher may run the jobs in other processes
        chosen: Any = OmegaConf.to_container(config)
        trust(*chosen["trusted"], *named_classes(chosen["model"]))
        trainer = OmegaConf.select(config, "trainer")
        with _as_exit():
            if (trainer.devices, trainer.num_nodes) != (1, 1):
                raise UserError(NO_SWEEP)
            self._running.enter_context(locked_folder(_folder(config), "hydra.sweep.dir"))
        verbose = OmegaConf.select(config, "verbose")
        Screen.verbose = verbose if isinstance(verbose, int) else NORMAL  # it may be swept

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:  # noqa: ANN401
        """Release a job's configuration, half a megabyte that Hydra would keep."""
        job_return.cfg = job_return.hydra_cfg = None

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401
        """Collect the results of the jobs.

        Raises:
            SystemExit: If it cannot be written.
        """
        with self._running, _as_exit():
            _summarise(_folder(config))


def _folder(config: DictConfig) -> Path:
    return Path(str(OmegaConf.select(config, "hydra.sweep.dir"))).resolve()


def _summarise(directory: Path) -> None:
    marks = [*directory.glob("*/.hydra/overrides.yaml"), *directory.glob(f"*/{FAILURE}")]
    jobs = sorted({directory / mark.relative_to(directory).parts[0] for mark in marks})
    jobs.sort(key=lambda path: natural_key(path.name))
    rows = [row for job in jobs for row in _rows(job)]
    rows += _pooled(rows)
    SweepSummary.failures = sum(row["status"] != "done" for row in rows)
    lines = [{**row, "overrides": " ".join(row["overrides"])} for row in rows]
    table = [[line.get(column, "") for column in COLUMNS] for line in lines]
    write_rows(directory / "sweep.csv", COLUMNS, table)
    _print(rows, directory)
    from tex_lightning.report.page import write_report  # heavy, and only now needed

    write_report(directory, jobs)


def runs_side_by_side(config: DictConfig) -> bool:
    """Return whether a launcher runs the jobs of a sweep in processes of their own."""
    return str(OmegaConf.select(config, "hydra.launcher._target_")) != ONE_BY_ONE


def _rows(job: Path) -> list[Row]:
    """Return a row for each network that a job tested, or one with its status."""
    start: Row = {"job": job.name, "overrides": run_overrides(job), "settings": run_settings(job)}
    if (job / FAILURE).is_file():
        failure = read_record(job / FAILURE)
        return [{**start, "overrides": failure["overrides"], "status": failure["error"]}]
    results = job / "results.json"
    if not results.is_file():
        silent = {f"task={task}" for task in SILENT} & {*start["overrides"]}
        return [{**start, "status": "done" if silent else "not finished"}]
    start["status"] = "done"
    # a frontier, a profile and a test of stability have tables of their own
    networks = read_record(results).get("networks", {})
    return [
        {
            **start,
            "network": name,
            "ci_low": network["vote_ci95"][0],
            "ci_high": network["vote_ci95"][1],
            "latency_ms": network["latency_ms"]["median"],
            **{key: network[key] for key in KEPT},
        }
        for name, network in networks.items()
        if "vote_accuracy" in network
    ] or [start]


def _pooled(rows: Sequence[Row]) -> list[Row]:
    """Return counts over jobs that differ in the tested fold alone, then means over seeds."""
    tested = [row for row in rows if "vote_accuracy" in row]
    folds, whole = [], []
    for members in _alike(tested, FOLD_KEYS):
        whole += members if len(members) == 1 else []
        if len(members) > 1:
            correct, count = (sum(row[key] for row in members) for key in KEPT[1:3])
            low, high = wilson_interval(correct, count)
            counts = {"correct": correct, "test_samples": count, "ci_low": low, "ci_high": high}
            folds.append({**_over("folds", members), **counts, "vote_accuracy": correct / count})
    seeds = []
    for members in _alike([*whole, *folds], ("seed",)):
        if len(members) > 1:  # they test the same samples, so no count is pooled
            values = [row["vote_accuracy"] for row in members]
            spread = {"vote_accuracy": mean(values), "vote_accuracy_sd": stdev(values)}
            seeds.append({**_over("seeds", members), **spread})
    return folds + seeds


def _alike(rows: Sequence[Row], keys: tuple[str, ...]) -> list[list[Row]]:
    """Return groups of rows of one network whose settings differ in ``keys`` alone."""
    groups: dict[str, list[Row]] = {}
    for row in rows:
        kept = {key: value for key, value in row["settings"].items() if key not in keys}
        groups.setdefault(json.dumps([row["network"], kept], sort_keys=True), []).append(row)
    return list(groups.values())


def _over(what: str, members: Sequence[Row]) -> Row:
    shared = set.intersection(*({*row["overrides"]} for row in members))
    return {
        "job": f"{len(members)} {what}",
        "overrides": [item for item in members[0]["overrides"] if item in shared],
        "settings": members[0]["settings"],
        "status": "done",
        "network": members[0]["network"],
        "fit_seconds": sum(row["fit_seconds"] for row in members),
    }


def _print(rows: Sequence[Row], directory: Path) -> None:
    """Print a line per row, with what distinguishes its overrides from those of all jobs."""
    table = make_table("sweep", ["job", "overrides", "network"], ["accuracy", "95 % CI", "fit s"])
    every = [{*row["overrides"]} for row in rows if " " not in row["job"]]
    shared = set.intersection(*every) if len(every) > 1 else set()
    for row in rows:
        varying = "\n".join(item for item in row["overrides"] if item not in shared)
        table.add_row(row["job"], varying, row.get("network", ""), *_figures(row))
    console.print(table)
    for row in rows:
        if row["status"] != "done":
            console.print(f"Job {row['job']}: {row['status']}", soft_wrap=True)
    if any(is_tiny(row["overrides"]) for row in rows):
        console.print(TINY, style="bold yellow")
    console.print(f"Summary in {directory / 'sweep.csv'}", soft_wrap=True)


def _figures(row: Row) -> tuple[str, ...]:
    """Return accuracy, interval and time of a row, as far as it has them."""
    if "vote_accuracy" not in row:
        return ("done" if row["status"] == "done" else "failed",)
    fit = f"{row['fit_seconds']:.1f}"
    if "vote_accuracy_sd" in row:
        return f"{row['vote_accuracy']:.1%} ± {row['vote_accuracy_sd']:.1%}", "", fit
    interval = f"{100 * row['ci_low']:.1f}-{100 * row['ci_high']:.1f}"
    return counted(row), interval, fit
