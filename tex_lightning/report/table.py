"""Tables of results, for the terminal, ``report.md`` and ``report.html``."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from omegaconf import OmegaConf
from rich import box
from rich.table import Table as Screened

from tex_lightning.config.overrides import hydra_settings
from tex_lightning.config.user_folders import is_added
from tex_lightning.core.console import DEBUG, Screen, console
from tex_lightning.core.files import read_or_empty
from tex_lightning.core.run_folder import SETTINGS
from tex_lightning.evaluation.conditions import CONDITIONS, by_size
from tex_lightning.evaluation.metrics import METRICS, counts_text, metrics_in, told

PAPER = Path(__file__).with_name("paper.yaml")
TINY = "debug=tiny shrank every budget of this run: its accuracy has no meaning."
PADDED = "label_agreement is below 1 where windows are padded at their edges."
FOLD_KEYS = ("data.test_fold", "data.val_fold")
# Beginnings of settings that leave a system what it is: its runs are pooled.
POOLED = (
    *FOLD_KEYS, "data.test_where", "crossval.", "model.name", "data.name", "task", "logger.",
    "hydra.",
)  # fmt: skip
MAX_LISTED = 12  # values of a condition that a table lists; results.json has all

Network = Mapping[str, Any]  # an entry of results.json
TableRow = Mapping[str, str]


class Table(NamedTuple):
    """A table for every medium, with a sentence above it.

    Rows are cells by heading; a column without any text is left out.
    """

    title: str
    rows: Sequence[TableRow]
    text: str = ""

    @property
    def headings(self) -> list[str]:
        """Headings of the columns that have text."""
        return list(dict.fromkeys(name for row in self.rows for name, cell in row.items() if cell))

    @property
    def cells(self) -> list[list[str]]:
        """Cells of every row, below the headings."""
        names = self.headings
        return [[row.get(name, "") for name in names] for row in self.rows]


def facts(results: Mapping[str, Any]) -> dict[str, dict[str, str]]:
    """Return the facts that tables and the page show, by name of the network.

    One that was trained on all recordings, and not tested, has those of its training.
    """
    networks: Mapping[str, Network] = results.get("networks", {})
    untested = {
        name: {
            "accuracy": "not tested",
            **_crossvalidated(network.get("crossval")),
            **told(network, metrics_in("summary")),
            **_uncounted(network),
        }
        for name, network in networks.items()
        if network.get("test_samples") == 0 and "parameters" in network
    }
    return untested or {
        name: {
            **told(network, metrics_in("summary", "votes")),
            "chance": f"{1 / len(results['classes']):.1%}",
            **told(network, metrics_in("summary", "scores")),
            **_rejections(network),
            **told(network, metrics_in("summary", "costs")),
            **_uncounted(network),
        }
        for name, network in networks.items()
        if "vote_accuracy" in network
    }


def fact_table(results: Mapping[str, Any]) -> Table:
    """Return a line for each fact of a run, with a column for each network."""
    shown = facts(results)
    names = {fact: None for network in shown.values() for fact in network}
    return Table(
        "Results",
        [
            {"": name, **{key: known.get(name, "") for key, known in shown.items()}}
            for name in names
        ],
    )


def counted(entry: Mapping[str, Any]) -> str:
    """Return the accuracy of an entry and its counts."""
    return f"{METRICS['vote_accuracy'].told(entry)} ({counts_text(entry)})"


def _crossvalidated(pooled: Mapping[str, Any] | None) -> dict[str, str]:
    """Return what a cross-validation of the same settings gave, if there was one."""
    if not pooled:
        return {}
    return {"cross-validated": f"{counted(pooled)}, {METRICS['vote_ci95'].told(pooled)}"}


def _rejections(network: Network) -> dict[str, str]:
    """Return the metrics of ``decision.unknown`` and ``data.hold_out``, if present."""
    cells: dict[str, str] = {}
    unknown = network.get("unknown", {})
    for key in ("false_rejections", "accepted_unknown"):
        if counts := unknown.get(key):
            cells[key.replace("_", " ")] = "{count}/{of} ({share:.1%})".format(**counts)
    aurocs = [unknown[key] for key in ("novelty_auroc", "auroc") if unknown.get(key) is not None]
    if aurocs:
        cells["AUROC of unknown"] = f"{aurocs[0]:.3f}"
    return cells


def profile_table(networks: Mapping[str, Network]) -> Table:
    """Return what ``task=profile`` measured, a column for each network."""
    rows = [
        {"": key, **{name: f"{network[key]:,.4g}" for name, network in networks.items()}}
        for key in next(iter(networks.values()))
    ]
    padded = any(network["label_agreement"] < 1 for network in networks.values())
    return Table("Profile", rows, PADDED if padded else "")


def _uncounted(network: Network) -> dict[str, str]:
    """Say it where the arithmetic is outside PyTorch."""
    metric = METRICS["macs_per_sample"]
    return {} if metric.of(network) is not None else {metric.heading: "not counted"}


def markdown(headings: Sequence[str], lines: Sequence[Sequence[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    first, *rows = [f"| {' | '.join(cells)} |" for cells in (headings, *lines)]
    return [first, f"|{'---|' * len(headings)}", *rows]


def print_results(results: dict[str, Any], directory: Path) -> None:
    """Print a column per network: accuracy with interval and counts, then its cost.

    A job of a sweep leaves this to the table of all jobs.
    """
    if Screen.sweep and Screen.verbose < DEBUG:
        return
    table = fact_table(results)
    title = f"{results['task']} · {results['model']} · {results['data']}"
    shown = make_table(title, table.headings[:1], table.headings[1:], table.cells)
    print_tables(directory, shown)


def condition_rows(networks: Mapping[str, Network]) -> list[dict[str, str]]:
    """Return the accuracy of each network by condition and value.

    A condition of a single value has no row, and one of very many is left to ``results.json``.
    """
    values: dict[str, dict[str, None]] = {}
    for entry in networks.values():
        for name, counts in entry.get(CONDITIONS, {}).items():
            values.setdefault(name, {}).update(dict.fromkeys(counts))
    rows = []
    for name, known in values.items():
        for value in sorted(known, key=by_size) if 1 < len(known) <= MAX_LISTED else ():
            entries = {network: entry.get(CONDITIONS, {}).get(name, {}).get(value)
                       for network, entry in networks.items()}  # fmt: skip
            cells = {
                network: counted(counts) if counts else "" for network, counts in entries.items()
            }
            rows.append({"condition": name, "value": value, **cells})
    return rows


def make_table(
    title: str, names: Sequence[str], figures: Sequence[str], rows: Iterable[Iterable[str]] = ()
) -> Screened:
    """Return a table of the terminal with as little ink as fits 80 columns.

    Columns of text, by their ``names``, go on in the next line; those of figures come after them.
    """
    table = Screened(title=title, box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in names:
        table.add_column(heading, overflow="fold")
    for heading in figures:
        table.add_column(heading, overflow="fold", no_wrap=True, justify="right")
    for cells in rows:
        table.add_row(*cells)
    return table


def print_tables(directory: Path, *tables: Screened) -> None:
    """Print tables, the path of the results, and a note if the run was only a trial."""
    for table in tables:
        console.print(table)
    if is_tiny(run_overrides(directory)):
        console.print(TINY, style="bold yellow")
    console.print(f"Results in {directory}", soft_wrap=True)


def run_settings(directory: Path) -> dict[str, Any]:
    """Return settings of a run folder by dotted key."""
    return read_or_empty(directory / SETTINGS)


def run_overrides(directory: Path) -> list[str]:
    """Return the overrides of a run folder as they were written; empty if none are on record."""
    path = directory / ".hydra" / "overrides.yaml"
    if not path.is_file():
        return []
    plain: Any = OmegaConf.to_container(OmegaConf.load(path), resolve=False)
    return [str(item) for item in plain]


def typed_overrides(directory: Path) -> list[str]:
    """Return the overrides of a run folder that somebody has given, without derived ones."""
    hydra = hydra_settings(directory)
    if not hydra:
        return run_overrides(directory)
    return [str(item) for item in hydra["overrides"]["task"] if not is_added(str(item))]


def is_tiny(overrides: Sequence[str]) -> bool:
    """Return whether a run only tried the plumbing."""
    return "debug=tiny" in [item.lstrip("+") for item in overrides]


@cache
def paper_tables() -> dict[str, dict[str, Any]]:
    """Return the tables of the paper by name, as ``paper.yaml`` has them."""
    tables: Any = OmegaConf.to_container(OmegaConf.load(PAPER))
    return dict(tables)


def model_label(model: str) -> str:
    """Return a configuration's name for readers: that of its row in ``paper.yaml``, or its own."""
    tables = paper_tables().values()
    rows = [row for table in tables for row in table["rows"] if row["model"] == model]
    return str(rows[0]["label"]) if rows else model.replace("_", " ")
