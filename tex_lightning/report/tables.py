"""Tables of systems as Markdown, with the paper's figures beside them where these belong."""

from collections.abc import Mapping, Sequence
from typing import Any

from tex_lightning.evaluation.comparison import mcnemar
from tex_lightning.evaluation.conditions import pool_conditions
from tex_lightning.evaluation.outcomes import summarise
from tex_lightning.report.systems import System
from tex_lightning.report.table import NONE, condition_rows, paper_table, seconds
from tex_lightning.text import to_markdown

KIND_TABLES = ("haptic", "visual", "fusion")
DATA_TABLES = ("kylberg", "kth_tips2b")
LABELS = {"haptic": "HapticNet", "visual": "VisualNet"}  # other senses have no published name
PAPER, OURS = ", paper", ", ours"  # ends of headings
HEADINGS = (
    "system", "votes, paper", "votes, ours", "95 % interval", "p against the best",
    "fragments, paper", "fragments, ours", "ms a sample", "fit s", "parameters",
)  # fmt: skip
NOT_RUN = "not run"


def accuracy_tables(systems: Sequence[System], *, complete: bool, paper: bool) -> str:
    """Return all tables that the systems have rows in.

    Args:
        systems: What was tested.
        complete: Whether rows that were not run are listed too.
        paper: Whether the paper's figures stand beside those measured here.
    """
    kinds = dict.fromkeys([*KIND_TABLES, *(system.kind for system in systems)])
    tables = {kind: _of_kind(kind, systems) for kind in kinds}
    for name in DATA_TABLES:
        visual = [item for item in systems if item.kind == "visual" and not item.inside]
        rows = [item for item in visual if item.data == name]
        if rows or complete:
            listed = {row["model"] for row in paper_table(name)["rows"]}
            tables[name] = [item for item in rows or visual if item.model in listed]
    return "\n\n".join(
        _table(name, rows, complete=complete, paper=paper) for name, rows in tables.items() if rows
    )


def _of_kind(kind: str, systems: Sequence[System]) -> list[System]:
    """Return the systems of a kind but for data sets with a table of their own."""
    rows = [item for item in systems if item.kind == kind and item.data not in DATA_TABLES]
    return [item for item in rows if not item.inside] or rows


def _table(name: str, systems: list[System], *, complete: bool, paper: bool) -> str:
    """Return a table of at least one system, in the order of the paper's."""
    title = f"{to_markdown(name.capitalize())} classification"
    table = paper_table(name) or {"title": title, "rows": []}
    best = max(systems, key=lambda system: summarise(system.outcomes)["vote_accuracy"])
    lines = []
    for row in table["rows"]:
        own = [item for item in systems if item.model == row["model"] and not item.inside]
        lines += [_line(row, item, best) for item in own]
        if not own and complete and ("vote" in row or "fragment" in row):
            lines.append(_not_run(row))
    order = [row["model"] for row in table["rows"]]
    rest = [item for item in systems if item.inside or item.model not in order]
    lines += [_line({"label": _label(item)}, item, best) for item in rest]
    data = to_markdown(", ".join(sorted({item.data for item in systems})))
    count = max(len(item.outcomes) for item in systems)
    classes = max(len(item.classes) for item in systems)
    text = (
        f"{'Ours' if paper else 'Data'}: {data}, {classes} classes (chance {1 / classes:.1%}), "
        f"{count} test samples."
    )
    if paper and table["rows"]:
        text += f" The paper's: {table['data']}."
    return _section(table["title"], text, HEADINGS, lines, paper=paper)


def _not_run(row: Mapping[str, Any]) -> list[str]:
    """Return a line of the paper's figures alone."""
    votes, fragments = _percent(row.get("vote")), _percent(row.get("fragment"))
    cells = [row["label"], votes, NOT_RUN, NONE, NONE, fragments, NOT_RUN]
    return [*cells, *[NONE] * (len(HEADINGS) - len(cells))]


def _line(row: Mapping[str, Any], system: System, best: System) -> list[str]:
    """Return the line of a tested system, in bold for the best one."""
    ours = summarise(system.outcomes)
    low, high = ours["vote_ci95"]
    label = to_markdown(row["label"] + (f" ({system.variant})" if system.variant else ""))
    return [
        f"**{label}**" if system is best else label,
        _percent(row.get("vote")),
        f"{ours['vote_accuracy']:.1%} ({ours['correct']}/{ours['test_samples']})",
        f"{low:.1%} to {high:.1%}",
        _against(best, system),
        _percent(row.get("fragment")),
        f"{ours['fragment_accuracy']:.1%}",
        f"{ours['latency_ms']['median']:.1f}",
        seconds(sum(entry["fit_seconds"] for entry in system.entries)),
        f"{system.entries[0]['parameters']:,}",
    ]


def _label(system: System) -> str:
    if system.inside:
        return f"{LABELS.get(system.kind, f'{system.kind} network')} inside {system.inside}"
    return system.model


def _percent(value: float | None) -> str:
    return NONE if value is None else f"{value:g} %"


def _against(best: System, system: System) -> str:
    """Return p of the exact McNemar test against the best row, with its counts."""
    if system is best:
        return "best"
    test = mcnemar(best.successes, system.successes_beside(best))
    return NONE if test is None else f"{test[2]:.2g} ({test[0]}:{test[1]})"


def conditions_table(systems: Sequence[System]) -> str:
    """Return votes by condition of every system, all its runs together; empty without any."""
    entries = {
        _label(system) + (f" ({system.variant})" if system.variant else ""): pool_conditions(
            system.entries
        )
        for system in systems
    }
    known = {name: entry for name, entry in entries.items() if entry}
    lines = [list(map(to_markdown, row)) for row in condition_rows(known, _votes)]
    if not lines:
        return ""
    text = (
        "Votes of all runs of a row together, with Wilson's intervals. A row that says unseen was "
        "trained without the conditions that it tested."
    )
    headings = ("condition", "value", *map(to_markdown, known))
    return _section("By condition", text, headings, lines, paper=True)


def _votes(counts: Mapping[str, Any]) -> str:
    low, high = counts["vote_ci95"]
    share = f"{counts['vote_accuracy']:.1%} ({counts['correct']}/{counts['test_samples']})"
    return f"{share}, {low:.1%} to {high:.1%}"


def profiling_table(networks: Mapping[str, Mapping[str, Any]], *, paper: bool) -> str:
    """Return times of dense passes and sliding windows, perhaps beside the paper's."""
    theirs = paper_table("profiling")
    lines = []
    for name, ours in networks.items():
        times = theirs.get(ours["kind"])
        windows, dense = (times["sliding_window_ms"], times["fcn_ms"]) if times else (0, 0)
        lines.append(
            [
                to_markdown(name),
                f"{windows} / {dense}" if times else NONE,
                f"{windows / dense:.1f}x" if times else NONE,
                f"{ours['sliding_window_ms']:.1f} / {ours['reference_ms']:.1f}",
                f"{ours['speedup']:.1f}x",
                f"{ours['speedup_same_engine']:.1f}x",
                f"{ours['label_agreement']:.1%}",
            ]
        )
    headings = (
        "network", "windows / dense (ms), paper", "ratio, paper", "windows / dense (ms), ours",
        "ratio, ours", "ratio in the same engine, ours", "labels equal",
    )  # fmt: skip
    text = f"The paper's: {theirs['device']}. Ratios compare across machines, milliseconds do not."
    return _section("Running time", text if paper else "", headings, lines, paper=paper)


def _section(
    title: str, text: str, headings: Sequence[str], lines: list[list[str]], *, paper: bool
) -> str:
    """Return a headed table in Markdown, with the paper's columns or without."""
    if not paper:
        kept = [n for n, heading in enumerate(headings) if not heading.endswith(PAPER)]
        headings = [headings[n].removesuffix(OURS) for n in kept]
        lines = [[line[n] for n in kept] for line in lines]
    table = "\n".join(markdown(headings, lines))
    return "\n\n".join(part for part in (f"### {title}", text, table) if part)


def markdown(headings: Sequence[str], lines: list[list[str]]) -> list[str]:
    """Return the lines of a table in Markdown."""
    return [
        f"| {' | '.join(headings)} |",
        f"|{'---|' * len(headings)}",
        *(f"| {' | '.join(cells)} |" for cells in lines),
    ]
