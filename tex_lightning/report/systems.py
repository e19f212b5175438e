"""Compare systems by their tests: read from run folders, pooled over folds and seeds, in tables."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import fmean, stdev
from typing import Any

from tex_lightning.core.run_folder import predictions_of, read_results
from tex_lightning.evaluation.comparison import mcnemar, pair
from tex_lightning.evaluation.conditions import pool_conditions
from tex_lightning.evaluation.metrics import METRICS, metrics_in, pooled_metrics, told
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, summarise
from tex_lightning.report.table import (
    POOLED,
    Table,
    TableRow,
    condition_rows,
    counted,
    paper_tables,
    run_settings,
)

PAPER_DATA = ("tum", "kylberg", "kth_tips2b")
DATA_TABLES = PAPER_DATA[1:]  # the paper has a table for each of them
MAX_SETTINGS = 4  # that a label shows
NOTES = """\
Accuracy is that of whole samples, fragments that of single positions. Intervals are Wilson's. p is
the exact McNemar test of the row against the top one, of the highest accuracy, on the same samples;
in brackets are the samples that only the top row and only this row classified correctly.
Milliseconds run from decoded recordings to the label on this machine; fit s is the training time of
all folds of a row. Of runs of one row and seed that test the same samples, the first counts."""


@dataclass(frozen=True)
class ReportedSystem:
    """One system and all its tests.

    Attributes:
        model: Name of its configuration.
        kind: Sense, or ``fusion``.
        inside: The FusionNet that trained it as its part; empty for a system of its own.
        data: Name of the data set's configuration.
        variant: Settings by which it differs from other systems of the same model.
        classes: Class names in order.
        entries: Entries of ``results.json``, one for each run.
        outcomes: Outcomes of all runs together, or of those with the first seed: others test the
            same samples.
        seeds: Accuracy of each seed, if there are several.
        conditions: Accuracy of the outcomes by condition, see :func:`pool_conditions`.
    """

    model: str
    kind: str
    inside: str
    data: str
    variant: str
    classes: list[str]
    entries: list[dict[str, Any]]
    outcomes: list[Outcome]
    seeds: Sequence[float] = ()
    conditions: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """Name in tables: that of the paper, if it has the system."""
        tables = [paper_tables()[name] for name in self.tables if name in paper_tables()]
        known = {row["model"]: row["label"] for table in tables for row in table["rows"]}
        name = str(known.get(self.model, self.model))
        if self.inside:  # whose network of this sense may be any
            name = f"{self.model} inside {self.inside}"
        return name + (f" ({self.variant})" if self.variant else "")

    @property
    def accuracy(self) -> float:
        """Accuracy of the samples, or its mean over seeds."""
        return fmean(self.seeds) if self.seeds else float(summarise(self.outcomes)["vote_accuracy"])

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the paper's tables that may have it."""
        return (self.data, self.kind) if self.data in DATA_TABLES else (self.kind,)


def read_systems(runs: Iterable[Path]) -> list[ReportedSystem]:
    """Read all systems that runs have tested; those that differ in fold or seed alone are one.

    Folders are those of ``fit``, ``crossval`` or ``evaluate``; others are passed over.
    """
    models: dict[tuple[str, ...], list[tuple[Path, dict[str, Any]]]] = {}
    for run in runs:
        results = read_results(run)
        names = list(results.get("networks", {}))
        for kind in names:
            if "vote_accuracy" in results["networks"][kind]:
                is_main = kind == names[-1]
                model, inside = (results["model"], "") if is_main else (kind, results["model"])
                models.setdefault((model, kind, inside, results["data"]), []).append((run, results))
    systems = []
    for key, members in models.items():
        groups: dict[str, list[tuple[Path, dict[str, Any]]]] = {}
        for member, variant in zip(members, _variants([run for run, _ in members]), strict=True):
            groups.setdefault(variant, []).append(member)
        systems += [_pool(key, variant, group) for variant, group in groups.items()]
    return systems


def _variants(runs: Sequence[Path]) -> list[str]:
    """Return what each run of one model has set differently from the others."""
    every = [run_settings(run) for run in runs]
    alike = (*POOLED, "seed")
    keys = {key for settings in every for key in settings if not key.startswith(alike)}
    differing = [key for key in keys if len({str(settings.get(key)) for settings in every}) > 1]
    # the same value under a longer key was taken from the shorter one
    differing.sort(key=lambda key: (key.count("."), key))
    variants = []
    for settings in every:
        shown = {(key.rpartition(".")[2], str(settings.get(key))): key for key in differing[::-1]}
        items = [f"{key}={value}" for (_, value), key in reversed(shown.items())]
        held = [key.split(".")[2] for key in settings if key.startswith("data.test_where.")]
        unseen = [f"unseen {' and '.join(dict.fromkeys(held))}"] if held else []
        variants.append(", ".join([*items[:MAX_SETTINGS], *unseen]))
    return variants


def _pool(
    key: tuple[str, ...], variant: str, members: Sequence[tuple[Path, dict[str, Any]]]
) -> ReportedSystem:
    model, kind, inside, data = key
    by_seed: dict[Any, dict[str, Outcome]] = {}
    entries: dict[Any, list[dict[str, Any]]] = {}
    for run, results in members:
        seed = run_settings(run).get("seed")
        tested = by_seed.setdefault(seed, {})
        found = read_outcomes(predictions_of(run, kind))
        if tested.keys().isdisjoint(outcome.sample for outcome in found):  # else they count twice
            tested |= {outcome.sample: outcome for outcome in found}
            entries.setdefault(seed, []).append(results["networks"][kind])
    every = [[*tested.values()] for tested in by_seed.values()]
    seeds = [float(summarise(outcomes)["vote_accuracy"]) for outcomes in every]
    return ReportedSystem(
        model, kind, inside, data, variant, members[0][1]["classes"],
        [entry for of_seed in entries.values() for entry in of_seed],
        every[0],
        seeds if len(seeds) > 1 else [],
        pool_conditions(next(iter(entries.values()))),
    )  # fmt: skip


def comparison_tables(systems: Sequence[ReportedSystem]) -> list[Table]:
    """Return every table that compares systems: accuracies, also by condition."""
    groups: dict[str, list[ReportedSystem]] = {}
    for system in systems:
        groups.setdefault(system.tables[0], []).append(system)
    tables = [
        accuracy_table(name, [system for system in group if not system.inside] or group)
        for name, group in groups.items()
    ]
    by_condition = {system.label: system.conditions for system in systems}
    tables.append(
        Table(
            "By condition",
            condition_rows({label: entry for label, entry in by_condition.items() if entry}),
            "A row marked unseen was trained without the conditions that it tested.",
        )
    )
    return [table for table in tables if table.rows]


def accuracy_table(name: str, systems: Sequence[ReportedSystem]) -> Table:
    """Return a line for each system, with the paper's figures where these are of the same data."""
    table = paper_tables().get(name, {})
    order = [row["model"] for row in table.get("rows", ())]
    ordered = sorted(
        systems,
        key=lambda system: order.index(system.model) if system.model in order else len(order),
    )
    top = max(systems, key=lambda system: system.accuracy)
    paper = {row["model"]: row for row in table.get("rows", ()) if top.data in PAPER_DATA}
    data = ", ".join(sorted({system.data for system in systems}))
    counts = sorted({len(system.classes) for system in systems})  # a sweep may vary the data
    classes = " or ".join(f"{count} classes (chance {1 / count:.1%})" for count in counts)
    text = f"Data: {data}, {classes}."
    if paper:
        text += f" The paper's: {table['data']}."
    rows = [
        _line(system, top, {} if system.inside else paper.get(system.model, {}))
        for system in ordered
    ]
    return Table(table.get("title") or f"{name.capitalize()} classification", rows, text)


def _line(system: ReportedSystem, top: ReportedSystem, paper: Mapping[str, Any]) -> TableRow:
    ours = {
        **system.entries[0],
        **pooled_metrics(system.outcomes, calibrated=False),
        "fit_seconds": sum(entry["fit_seconds"] for entry in system.entries),
    }
    if system.seeds:  # what is right of the first of them is not told beside the mean of all
        ours["fragment_accuracy"] = None
    return {
        "system": system.label,
        "accuracy, paper": f"{paper['vote']:g} %" if "vote" in paper else "",
        "accuracy": _seeds(system) if system.seeds else counted(ours),
        "95 % interval": "" if system.seeds else METRICS["vote_ci95"].told(ours),
        **({} if system.seeds else told(ours, metrics_in("comparison", "scores"))),
        "p against the top": "top" if system is top else _against(top, system),
        "fragments, paper": f"{paper['fragment']:g} %" if "fragment" in paper else "",
        **told(ours, metrics_in("comparison", "costs")),
    }


def _seeds(system: ReportedSystem) -> str:
    """Return the mean accuracy with its deviation; no interval, as seeds test the same samples."""
    return f"{system.accuracy:.1%} ± {stdev(system.seeds):.1%} ({len(system.seeds)} seeds)"


def _against(top: ReportedSystem, system: ReportedSystem) -> str:
    """Return p of the exact McNemar test against the row of highest accuracy, with its counts.

    A system of fewer senses is compared on its part of each sample; a dash stands where the
    samples are others, or where one of both has several seeds.
    """
    if top.seeds or system.seeds:
        return "-"
    pairs = pair(system.outcomes, top.outcomes)
    if pairs is None or len(pairs) < len(top.outcomes):
        return "-"
    _, ours, others = zip(*pairs, strict=True)
    only_top, only_own, p_value = mcnemar(others, ours)
    return f"{p_value:.2g} ({only_top}:{only_own})"
