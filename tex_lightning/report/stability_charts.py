"""Tables and the figure of ``task=stability``."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from tex_lightning.core.console import console
from tex_lightning.evaluation.robustness import KEPT_SHARE, LEVEL, StabilityRow, find_failures
from tex_lightning.perturbations.table import SEVERITIES, Perturbation
from tex_lightning.report.style import COLOURS, GUIDE, Look, brief, styled
from tex_lightning.report.table import Table, counted, make_table, print_tables

MAX_PRINTED = 20  # lines of what fails first that a terminal gets
FAILS_FIRST = (
    f"What fails first is on top. Lower from: the first severity at which the exact McNemar test "
    f"against the unperturbed samples is significant ({LEVEL:.0%} over the {len(SEVERITIES)} "
    f"severities together). Broken from: the first at which accuracy is less than "
    f"{KEPT_SHARE:.0%} of what it is unperturbed; the breaking point is where it crosses that, "
    f"between two severities."
)


def failure_table(results: Mapping[str, Any]) -> Table:
    """Return what fails first, from ``results.json``, for every medium but the terminal."""
    names = {key: entry["name"] for key, entry in results["systems"].items()}
    several = len({entry["modality"] for entry in results["failures"]}) > 1
    rows = [
        {
            "perturbation": entry["perturbation"].replace("_", " "),
            "of": entry["modality"] if several else "",
            "system": names[entry["system"]],
            "breaking point": _valued(entry["breaking_value"], entry["unit"]),
            "lower from": _found(entry["lower_from"], entry["unit"]),
            "broken from": _found(entry["broken_from"], entry["unit"]),
            "unperturbed": _counts(entry["clean"]),
            "mean error": f"{entry['mean_error']:.1%}",
        }
        for entry in results["failures"]
    ]
    return Table("What fails first", rows, FAILS_FIRST)


def _counts(trial: Mapping[str, Any]) -> str:
    low, high = trial["ci95"]
    share = f"{trial['correct']}/{trial['test_samples']}"
    return f"{share}, {100 * low:.1f} to {100 * high:.1f} %"


def _found(trial: Mapping[str, Any] | None, unit: str) -> str:
    """Return a trial with its value, counts and interval; a dash where there is none."""
    if trial is None:
        return "-"
    return f"{_number(trial['value'])} {unit} (severity {trial['severity']}): {_counts(trial)}"


def _number(value: float) -> str:
    """Return a value with three digits and without an exponent."""
    return f"{float(f'{value:.3g}'):g}"


def _valued(value: float | None, unit: str) -> str:
    return "-" if value is None else f"{_number(value)} {unit}"


def print_stability(results: dict[str, Any], directory: Path) -> None:
    """Print clean accuracy, mean error and flip rate of each system, and what fails first."""
    figures = ["clean accuracy", "mean error", "flips"]
    table = make_table(f"stability · {results['data']}", ["system"], figures)
    for entry in results["systems"].values():
        if "clean" not in entry:
            table.add_row(entry["name"], "none applies")
            continue
        table.add_row(
            entry["name"],
            counted(entry["clean"]),
            f"{entry['mean_error']:.1%}",
            f"{entry['mean_flip_rate']:.1%}",
        )
    console.print(table)
    _print_failures(results)
    print_tables(directory)


def _print_failures(results: Mapping[str, Any]) -> None:
    """Print the first lines of what fails first; the page has all."""
    entries = results["failures"]
    several = len({entry["system"] for entry in entries}) > 1
    headings = ["system"] * several + ["perturbation", "lower from", "broken from"]
    table = make_table("what fails first", headings, [])
    for entry in entries[:MAX_PRINTED]:
        cells = [_short(entry[key], entry["unit"]) for key in ("lower_from", "broken_from")]
        if entry["broken_from"]:
            cells[1] += f"\nbreaks at {_number(entry['breaking_value'])}"
        name = entry["perturbation"].replace("_", " ")
        label = [results["systems"][entry["system"]]["name"]] if several else []
        table.add_row(*label, name, *cells)
    left = len(entries) - MAX_PRINTED
    table.caption = (
        f"lower: McNemar's test, {LEVEL:.0%} over all severities; broken: less than "
        f"{KEPT_SHARE:.0%} of the clean accuracy" + (f"; {left} more in report.html" * (left > 0))
    )
    console.print(table)


def _short(trial: Mapping[str, Any] | None, unit: str) -> str:
    """Return the value of a trial and, in a second line, its counts and interval."""
    if trial is None:
        return "-"
    low, high = trial["ci95"]
    counts = f"{trial['correct']}/{trial['test_samples']}, {100 * low:.0f}-{100 * high:.0f} %"
    return f"{_number(trial['value'])} {unit}\n{counts}"


LABELS = 2.3  # inches for the names of the perturbations
NAMES = 18  # characters of a line of a system's name
CELL = 0.52  # inches, the height of a cell
STEPS = len(SEVERITIES)
WIDTH, HEIGHT = 1.2 * STEPS, 1.35  # of a cell and the gap after it, in severities and accuracies
FINE, LOWER, BROKEN = Look(COLOURS[0], "o"), Look(COLOURS[3], "s"), Look(COLOURS[4], "X")


@styled
def stability_figure(
    trials: Sequence[StabilityRow],
    table: Mapping[str, Perturbation],
    systems: Mapping[str, str],
    chances: Mapping[str, float],
) -> Figure:
    """Draw a cell for each system and perturbation: accuracy with interval over severity.

    Perturbations are rows, grouped by modality, what fails first on top; systems are columns. The
    dots are blue, orange where accuracy is significantly lower, and red where the system is broken.

    Perturbations are by name; so are the labels of the systems that have a column, in order, and
    their accuracies of guessing: some know more classes than others.
    """
    failures = find_failures(trials)
    modalities = list(dict.fromkeys(table[failure.clean.perturbation].modality
                                    for failure in failures))  # fmt: skip
    names = sorted(
        dict.fromkeys(failure.clean.perturbation for failure in failures),
        key=lambda name: modalities.index(table[name].modality),
    )
    columns = max(min(2.6, 7.2 / len(systems)), 1.0)
    size = (LABELS + columns * len(systems), 1.5 + CELL * len(names))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots()
    for failure in failures:
        clean = failure.clean
        place = (list(systems).index(clean.system), names.index(clean.perturbation))
        rows = [
            x for x in trials if (x.system, x.perturbation) == (clean.system, clean.perturbation)
        ]
        first = [x.severity if x else STEPS + 1 for x in (failure.lower, failure.broken)]
        _draw_cell(axes, rows, place, first, chances[clean.system])
    _name_cells(axes, [table[name] for name in names], list(systems.values()), len(modalities) > 1)
    _explain(figure)
    return figure


def _draw_cell(
    axes: Axes,
    rows: Sequence[StabilityRow],
    place: tuple[int, int],
    first: Sequence[float],
    chance: float,
) -> None:
    """Draw the accuracies of one system under one perturbation, from 0 to 100 %, in its cell.

    Its place is column and row; accuracy is lower, and the system broken, from the severities
    ``first``.
    """
    left, bottom = place[0] * WIDTH, -place[1] * HEIGHT
    axes.add_patch(
        Rectangle((left - 0.3, bottom), STEPS + 0.6, 1, facecolor="#f3f5f8", edgecolor="none")
    )
    axes.plot([left - 0.3, left + STEPS + 0.3], [bottom + chance] * 2, color=GUIDE, linestyle=":")
    across = [left + row.severity for row in rows]
    axes.plot(across, [bottom + row.vote_accuracy for row in rows], color=GUIDE, linewidth=0.8)
    for x, row in zip(across, rows, strict=True):
        look = FINE if row.severity < first[0] else LOWER
        look = look if row.severity < first[1] else BROKEN
        ends = [bottom + row.ci_low, bottom + row.ci_high]
        axes.plot([x, x], ends, color=look.colour, linewidth=1)
        axes.plot(x, bottom + row.vote_accuracy, color=look.colour, marker=look.marker)


def _name_cells(
    axes: Axes, perturbations: Sequence[Perturbation], systems: Sequence[str], several: bool
) -> None:
    """Name rows, with the values of the least and the highest severity, and columns."""
    texts = []
    for kind in perturbations:
        ends = f"{_number(kind.value(1))} to {_number(kind.value(STEPS))} {kind.unit}"
        said = f" ({kind.modality})" if several else ""
        texts.append(f"{brief(kind.name.replace('_', ' '))}{said}\n{brief(ends)}")
    axes.set_yticks([0.5 - row * HEIGHT for row in range(len(texts))], texts)
    axes.set_xticks(
        [column * WIDTH + STEPS / 2 for column in range(len(systems))],
        [fill(brief(name), NAMES, break_on_hyphens=False) for name in systems],
    )
    axes.tick_params(length=0)
    axes.tick_params(axis="x", top=True, labeltop=True, bottom=False, labelbottom=False)
    axes.set(xlim=(-0.4, (len(systems) - 1) * WIDTH + STEPS + 0.4))
    axes.set(ylim=(-(len(texts) - 1) * HEIGHT - 0.25, 1.1))
    axes.spines[:].set_visible(False)


def _explain(figure: Figure) -> None:
    """Say what dots, colours and lines are."""
    figure.suptitle("Accuracy (0 to 100 % in each cell) as it is and at severities 1 to 5")
    handles = [
        *(
            Line2D([], [], color=look.colour, marker=look.marker, linestyle="")
            for look in (FINE, LOWER, BROKEN)
        ),
        Line2D([], [], color=GUIDE, linestyle=":"),
    ]
    texts = [
        "not significantly lower",
        f"significantly lower (McNemar, {LEVEL:.0%} over all severities)",
        f"from less than {KEPT_SHARE:.0%} of the clean accuracy on", "chance",
    ]  # fmt: skip
    columns = 2 if figure.get_figwidth() > 6 else 1
    figure.legend(
        handles, texts, loc="outside lower center", ncols=columns,
        title="Bars are Wilson's 95 % intervals", title_fontsize=7, frameon=False,
    )  # fmt: skip
