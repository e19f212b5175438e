"""Rows of the table of a sweep: a job each, folds pooled, means over seeds.

The best row is what the objective of a search says, the least validation loss. Where nothing was
searched for no row is the best: that with the highest accuracy was found on the test fold.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, stdev
from typing import Any

from tex_lightning.config import SILENT
from tex_lightning.core.files import read_record
from tex_lightning.core.run_folder import FAILURE, read_results
from tex_lightning.evaluation.metrics import METRICS, figures, metrics_in
from tex_lightning.evaluation.outcomes import COUNTS
from tex_lightning.evaluation.outcomes import counted as counted_votes
from tex_lightning.report.table import FOLD_KEYS, Table, counted, run_settings, typed_overrides

TrialRow = dict[str, Any]

JOB = "job"
LOSS = "val_loss"  # what a search minimises
LONG = 8  # characters from which on a number is shortened
BEST = "best"  # column of the mark, and the mark
SEARCHED = f"Best is the job with the least {LOSS}, the objective of the search."
NOT_SEARCHED = (
    "No row is called the best: nothing was searched for, and the highest accuracy was found on "
    "the test fold."
)


def columns() -> list[str]:
    """Return the columns of ``sweep.csv`` beside the keys that were swept."""
    accuracy, *others = (metric.name for metric in metrics_in("sweep"))
    return [
        JOB, "overrides", "status", "network", accuracy, f"{accuracy}_sd", *others, BEST,
    ]  # fmt: skip


def sweep_rows(jobs: Sequence[Path], *, searched: bool) -> list[TrialRow]:
    """Return a row for each network of each job, then those of folds, then those of seeds.

    A row is cells by column; ``overrides`` is a list, ``settings`` a dict, and ``members`` the rows
    that it sums up. A search, unlike other sweeps, has an objective and so a best job.
    """
    rows = [row for job in jobs for row in _of_job(job)]
    if searched:
        _mark_best(rows)
    return rows + _pooled(rows)


def _of_job(job: Path) -> list[TrialRow]:
    """Return a row for each network that a job tested, or one with its status.

    A finished job that was to run again with other settings has both.
    """
    start: TrialRow = {
        JOB: job.name,
        "overrides": typed_overrides(job),
        "settings": run_settings(job),
    }
    failed = []
    if (job / FAILURE).is_file():
        failure = read_record(job / FAILURE)
        failed = [{**start, "overrides": failure["overrides"], "status": failure["error"]}]
    results = read_results(job)
    if not results:
        silent = {f"task={task}" for task in SILENT} & {*start["overrides"]}
        return failed or [{**start, "status": "done" if silent else "not finished"}]
    start["status"] = "done"
    # a frontier, a profile and a test of stability have tables of their own
    networks = results.get("networks", {})
    tested = [
        {**start, "network": name, **figures(network, metrics_in("sweep"))}
        for name, network in networks.items()
        if "vote_accuracy" in network or network.get("test_samples") == 0
    ]
    return failed + (tested or [start])


def _mark_best(rows: Sequence[TrialRow]) -> None:
    """Mark the job whose requested model has the smallest loss."""
    asked = {row[JOB]: row for row in rows}.values()
    known = [row for row in asked if row.get(LOSS) is not None]
    if known:
        min(known, key=lambda row: float(row[LOSS]))[BEST] = BEST


def _pooled(rows: Sequence[TrialRow]) -> list[TrialRow]:
    """Return counts over jobs that differ in the tested fold alone, then means over seeds."""
    tested = [row for row in rows if "vote_accuracy" in row]
    folds, whole = [], []
    for members in _alike(tested, FOLD_KEYS):
        whole += members if len(members) == 1 else []
        if len(members) > 1:
            correct, count = (sum(row[key] for row in members) for key in COUNTS[:2])
            votes = figures(counted_votes(correct, count), metrics_in("sweep", "votes"))
            folds.append({**_over("folds", members), **votes})
    seeds = []
    for members in _alike([*whole, *folds], ("seed",)):
        if len(members) > 1:  # they test the same samples, so no count is pooled
            values = [row["vote_accuracy"] for row in members]
            spread = {"vote_accuracy": mean(values), "vote_accuracy_sd": stdev(values)}
            seeds.append({**_means(members), **_over("seeds", members), **spread})
    return folds + seeds


def _means(members: Sequence[TrialRow]) -> TrialRow:
    """Return the mean of each figure that all members have; counts have none."""
    names = [metric.name for metric in metrics_in("sweep", "scores", "costs")]
    common = [name for name in names if all(row.get(name) is not None for row in members)]
    return {name: mean(row[name] for row in members) for name in common}


def _alike(rows: Sequence[TrialRow], keys: tuple[str, ...]) -> list[list[TrialRow]]:
    """Return groups of rows of one network whose settings differ in ``keys`` alone.

    A trial that a search made twice differs in nothing, and is in one group once.
    """
    groups: dict[str, dict[str, TrialRow]] = {}
    for row in rows:
        kept = {key: value for key, value in row["settings"].items() if key not in keys}
        group = groups.setdefault(json.dumps([row["network"], kept], sort_keys=True), {})
        group.setdefault(str([row["settings"].get(key) for key in keys[:1]]), row)
    return [[*group.values()] for group in groups.values()]


def _over(what: str, members: Sequence[TrialRow]) -> TrialRow:
    shared = set.intersection(*({*row["overrides"]} for row in members))
    losses = [row[LOSS] for row in members if row.get(LOSS) is not None]
    return {
        JOB: f"{len(members)} {what}",
        "overrides": [item for item in members[0]["overrides"] if item in shared],
        "settings": members[0]["settings"],
        "status": "done",
        "network": members[0]["network"],
        "fit_seconds": sum(row["fit_seconds"] for row in members),
        LOSS: mean(losses) if len(losses) == len(members) else None,
        BEST: BEST if any(row.get(BEST) for row in members) else "",
        "members": [id(row) for row in members],
    }


def shown_rows(rows: Sequence[TrialRow]) -> list[TrialRow]:
    """Return the rows for people: what sums up others stands at the place of the first of them."""
    places = {id(row): place for place, row in enumerate(rows)}
    hidden: set[int] = set()
    for row in rows:
        if members := row.get("members"):
            hidden.update(members)
            places[id(row)] = min(places[member] for member in members)
    return sorted((row for row in rows if id(row) not in hidden), key=lambda row: places[id(row)])


def assigned(row: TrialRow) -> dict[str, str]:
    """Return the values that the overrides of a row give, by key."""
    pairs = (item.lstrip("+~").partition("=") for item in row["overrides"])
    return {key: value for key, _, value in pairs}


def swept_keys(rows: Sequence[TrialRow]) -> list[str]:
    """Return the keys whose values differ between jobs, in the order of the overrides."""
    jobs = [assigned(row) for row in rows if "members" not in row]
    keys = dict.fromkeys(key for values in jobs for key in values)
    return [key for key in keys if len({values.get(key) for values in jobs}) > 1]


def short_names(keys: Sequence[str]) -> dict[str, str]:
    """Return the last parts of dotted keys, as many as tell them apart."""
    names = {}
    for key in keys:
        parts = key.split(".")
        tails = [".".join(parts[-n:]) for n in range(1, len(parts) + 1)]
        alone = (t for t in tails if sum(f".{other}".endswith(f".{t}") for other in keys) == 1)
        names[key] = next(alone, key)
    return names


def sweep_table(rows: Sequence[TrialRow], *, searched: bool) -> Table:
    """Return the table of a sweep for readers: swept keys first, then results."""
    keys = swept_keys(rows)
    names = short_names(keys)
    lines = [
        {
            **{names[key]: short(assigned(row).get(key, "")) for key in keys},
            JOB: row[JOB],
            "network": row.get("network", ""),
            **told_figures(row, searched),
        }
        for row in shown_rows(rows)
    ]
    said = SEARCHED if searched else NOT_SEARCHED
    return Table("Sweep", lines, f"{said} Of seeds: mean and standard deviation.")


def failure_tables(rows: Sequence[TrialRow]) -> list[Table]:
    """Return a table of the jobs that are not done and why, if there are any."""
    lines = [{JOB: row[JOB], "reason": row["status"]} for row in rows if row["status"] != "done"]
    return [Table("Jobs that are not done", lines)] if lines else []


def short(value: str) -> str:
    """Return a number of many digits with four."""
    try:
        return value if len(value) < LONG else f"{float(value):.4g}"
    except ValueError:
        return value


def told_figures(row: TrialRow, searched: bool) -> dict[str, str]:
    """Return the figures of a row as text, by heading."""
    loss = METRICS[LOSS]
    return {
        "accuracy": _accuracy(row),
        "95 % CI": f"{100 * row['ci_low']:.1f}-{row['ci_high']:.1%}" if "ci_low" in row else "",
        loss.heading: loss.text(row.get(LOSS)) if searched else "",
        **{metric.heading: metric.text(row.get(metric.name)) for metric in metrics_in("trials")},
        BEST: row.get(BEST, ""),
    }


def _accuracy(row: TrialRow) -> str:
    """Return the accuracy of a row, or its status."""
    if "vote_accuracy" not in row:
        untested = "not tested" if "network" in row else "done"
        return untested if row["status"] == "done" else "failed"
    if "vote_accuracy_sd" in row:
        return f"{row['vote_accuracy']:.1%} ± {row['vote_accuracy_sd']:.1%}"
    return counted(row)
