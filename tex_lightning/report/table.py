"""The closing table of a run, votes by condition, and what tables are made with."""

import shlex
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from omegaconf import OmegaConf
from rich import box
from rich.measure import Measurement
from rich.table import Table

from tex_lightning.core.console import DEBUG, Screen, console
from tex_lightning.core.files import write_rows
from tex_lightning.evaluation.conditions import KEY, pool_conditions

PAPER = Path(__file__).with_name("paper.yaml")
TINY = "debug=tiny shrank every budget of this run: its figures mean nothing."
WIDE = 1000  # columns, for which no table is too wide
NONE = "-"
OLD, NEW = "old_classes", "new_classes"  # of an entry of task=enroll
ENROLLED = {OLD: "old classes", NEW: "new classes"}
CONDITIONS_FILE = "conditions.csv"
CONDITIONS_COLUMNS = (
    "condition", "value", "network", "correct", "test_samples", "vote_accuracy", "ci_low",
    "ci_high",
)  # fmt: skip
MAX_LISTED = 12  # values of a condition that a table does not list

Network = dict[str, Any]
Networks = Mapping[str, Mapping[str, Any]]  # entries of results.json, by name
Counts = Mapping[str, Any]


def facts(results: dict[str, Any]) -> dict[str, dict[str, str]]:
    """What tables and the page say of each tested network, by its name."""
    networks: dict[str, Network] = results.get("networks", {})
    return {
        name: {
            "votes": f"{network['vote_accuracy']:.1%}",
            "correct": f"{network['correct']}/{network['test_samples']}",
            "95 % interval": "{:.1%} to {:.1%}".format(*network["vote_ci95"]),
            "chance": f"{1 / len(results['classes']):.1%}",
            **{text: _counted(network[key]) for key, text in ENROLLED.items() if key in network},
            **rejections(network),
            "fragments": f"{network['fragment_accuracy']:.1%}",
            "ms/sample": f"{network['latency_ms']['median']:.1f}",
            "fit s": seconds(network["fit_seconds"]),
            "parameters": f"{network['parameters']:,}",
            "MMAC/sample": _millions(network["macs_per_sample"]),
        }
        for name, network in networks.items()
        if "vote_accuracy" in network
    }


def _counted(votes: dict[str, Any]) -> str:
    return f"{votes['correct']}/{votes['test_samples']} ({votes['vote_accuracy']:.1%})"


def rejections(network: Network) -> dict[str, str]:
    """What ``reject_below``, ``decision.unknown`` and ``data.hold_out`` led to, if given."""
    said: dict[str, str] = {}
    if selective := network.get("selective"):
        accuracy = selective["selective_accuracy"]
        said[f"labelled (from {selective['reject_below']:g})"] = f"{selective['coverage']:.1%}"
        said["correct of these"] = NONE if accuracy is None else f"{accuracy:.1%}"
    unknown = network.get("unknown", {})
    if "rate" in unknown:
        said[f"known rejected (asked {unknown['rate']:.0%})"] = _share(unknown, "false_rejections")
        said["unknown accepted"] = _share(unknown, "accepted_unknown")
    aurocs = [unknown.get(key) for key in ("novelty_auroc", "auroc")]
    if known := [value for value in aurocs if value is not None]:
        said["AUROC of unknown"] = f"{known[0]:.3f}"
    return said


def _share(unknown: Network, key: str) -> str:
    """A count and its share; a dash where nothing set a threshold, or nothing was tested."""
    counts = unknown.get(key)
    return NONE if counts is None else f"{counts['count']}/{counts['of']} ({counts['share']:.1%})"


def print_results(results: dict[str, Any], directory: Path) -> None:
    """Print a column per network: accuracy with interval and counts, then its cost.

    A job of a sweep leaves this to the table of all jobs.
    """
    if Screen.sweep and Screen.verbose < DEBUG:
        return
    title = f"{results['task']} · {results['model']} · {results['data']}"
    shown = facts(results)
    table = make_table(title, [""], list(shown))
    for fact in {fact: None for network in shown.values() for fact in network}:
        table.add_row(fact, *(network.get(fact, "") for network in shown.values()))
    print_tables(directory, table, *_by_condition(results, directory))


def _by_condition(results: dict[str, Any], directory: Path) -> list[Table]:
    """A table of votes by condition, where a manifest gives them or ``data.test_where`` does."""
    asked = any(item.lstrip("+").startswith("data.test_where") for item in run_overrides(directory))
    if results["data"] != "manifest" and not asked:
        return []
    networks = results["networks"]
    rows = condition_rows(
        networks, "{0[vote_accuracy]:.1%} ({0[correct]}/{0[test_samples]})".format
    )
    table = make_table("votes by condition", ["", ""], list(networks))
    for row in rows:
        table.add_row(*row)
    return [table] if rows else []


def write_conditions(networks: Networks, directory: Path) -> None:
    """Write ``conditions.csv``; nothing without conditions."""
    lines = [
        (*place, network, counts["correct"], counts["test_samples"], counts["vote_accuracy"],
         *counts["vote_ci95"])
        for place, votes in _condition_votes(networks).items()
        for network, counts in votes.items()
    ]  # fmt: skip
    if lines:
        write_rows(directory / CONDITIONS_FILE, CONDITIONS_COLUMNS, lines)


def condition_rows(networks: Networks, say: Callable[[Counts], str]) -> list[list[str]]:
    """Return rows of a table: condition, value and what ``say`` makes of each network's votes.

    A condition of many values, such as a date, has one row that names the file with all of them;
    one of a single value has none, as its votes are those of all samples.
    """
    rows: dict[str, list[list[str]]] = {}
    for (name, value), votes in _condition_votes(networks).items():
        cells = [say(votes[network]) if network in votes else "" for network in networks]
        rows.setdefault(name, []).append([name, value, *cells])
    for name, lines in rows.items():
        if len(lines) > MAX_LISTED:
            file = f"{len(lines)} values, see {CONDITIONS_FILE}"
            rows[name] = [[name, file, *[""] * len(networks)]]
        elif len(lines) == 1:
            rows[name] = []
    return [line for lines in rows.values() for line in lines]


def _condition_votes(networks: Networks) -> dict[tuple[str, str], dict[str, Counts]]:
    """Return votes by condition and value, and there by network."""
    pooled = pool_conditions(networks.values()).get(KEY, {})
    places = [(name, value) for name, values in pooled.items() for value in values]
    return {
        (name, value): {
            network: entry[KEY][name][value]
            for network, entry in networks.items()
            if value in entry.get(KEY, {}).get(name, {})
        }
        for name, value in places
    }


def make_table(title: str, names: list[str], figures: list[str]) -> Table:
    """A table with as little ink as fits 80 columns; long names go on in the next line.

    Args:
        title: Above it.
        names: Headings of columns of text.
        figures: Headings of columns of figures, after those.
    """
    table = Table(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in names:
        table.add_column(heading, overflow="fold")
    for heading in figures:
        table.add_column(heading, overflow="fold", no_wrap=True, justify="right")
    return table


def print_table(table: Table) -> None:
    """Print a table; where a terminal is too narrow for it, figures go on in the next line."""
    wide = console.options.update(width=WIDE)
    if Measurement.get(console, wide, table).minimum > console.width:
        for column in table.columns:
            column.no_wrap = False
    console.print(table)
    if table.caption:  # an empty line, which others end with
        console.print()


def print_tables(directory: Path, *tables: Table) -> None:
    """Print tables, the path of the results, and a note if the run was only a trial."""
    for table in tables:
        print_table(table)
    if is_tiny(run_overrides(directory)):
        console.print(TINY, style="bold yellow")
    console.print(f"Results in {directory}", soft_wrap=True)


def run_overrides(directory: Path) -> list[str]:
    """Overrides of a run folder, as they were written; empty if it has none on record."""
    path = directory / ".hydra" / "overrides.yaml"
    return written(OmegaConf.load(path)) if path.is_file() else []


def run_flags(directory: Path) -> list[str]:
    """The ``--config-dir`` that a run folder was made with; empty if it has none on record."""
    path = directory / ".hydra" / "hydra.yaml"
    return folder_flags(OmegaConf.load(path)) if path.is_file() else []


def folder_flags(config: Any) -> list[str]:  # noqa: ANN401  (OmegaConf's)
    """The ``--config-dir`` that Hydra was given, by its own part of a configuration."""
    sources = OmegaConf.select(config, "hydra.runtime.config_sources", default=[])
    given = [each.path for each in sources if each.provider == "command-line"]
    return [part for folder in given for part in ("--config-dir", str(folder))]


def written(overrides: Any) -> list[str]:  # noqa: ANN401  (a list, or one of OmegaConf's)
    """Overrides with their interpolations as such: outside of the job some have no value."""
    plain: Any = OmegaConf.to_container(OmegaConf.create(overrides), resolve=False)
    return [str(item) for item in plain]


def is_tiny(overrides: list[str]) -> bool:
    """Whether a run only tried the plumbing."""
    return "debug=tiny" in [item.lstrip("+") for item in overrides]


def python_command(*arguments: str) -> str:
    """The command that runs this package with some arguments."""
    return shlex.join(["python", "-m", "tex_lightning", *arguments])


def seconds(value: float) -> str:
    """A time as every table has it."""
    return f"{value:.1f}"


def _millions(macs: int | None) -> str:
    return "not counted" if macs is None else f"{macs / 1e6:,.0f}"


def paper_table(name: str) -> dict[str, Any]:
    """Return one table of the paper from ``paper.yaml``; empty if it has none of this name."""
    tables: Any = OmegaConf.to_container(OmegaConf.load(PAPER))
    table: dict[str, Any] = tables.get(name, {})
    return table
