"""Tables of systems as Markdown, with the paper's figures beside them where these belong."""

from collections.abc import Mapping, Sequence
from statistics import mean, stdev
from typing import Any

from tex_lightning.evaluation.comparison import mcnemar
from tex_lightning.evaluation.conditions import pool_conditions
from tex_lightning.evaluation.outcomes import summarise
from tex_lightning.report.systems import System
from tex_lightning.report.table import NONE, condition_rows, paper_table, rejections, seconds
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
RATIOS = "Ratios compare across machines, milliseconds do not."


def accuracy_tables(systems: Sequence[System], *, complete: bool, paper: bool) -> str:
    """All tables that the systems have rows in.

    Args:
        systems: What was tested.
        complete: Whether rows that were not run are listed too.
        paper: Whether the paper's figures stand beside those measured here.
    """
    asked = {"complete": complete, "paper": paper}
    own = [system for system in systems if not system.inside]
    kinds = dict.fromkeys([*KIND_TABLES, *(system.kind for system in systems)])
    parts = [_table(kind, _of_kind(kind, systems), **asked) for kind in kinds]
    for name in DATA_TABLES:
        visual = [system for system in own if system.kind == "visual"]
        rows = [system for system in visual if system.data == name] or visual
        listed = {row["model"] for row in paper_table(name)["rows"]}
        rows = [system for system in rows if system.model in listed]
        if complete or any(system.data == name for system in rows):
            parts.append(_table(name, rows, **asked))
    return "\n\n".join(part for part in parts if part)


def _of_kind(kind: str, systems: Sequence[System]) -> list[System]:
    """Systems of one table; data sets with a table of their own stay out of the others."""
    mine = [system for system in systems if system.kind == kind and system.data not in DATA_TABLES]
    return [system for system in mine if not system.inside] or mine


def _table(name: str, systems: list[System], *, complete: bool, paper: bool) -> str:
    """One table; empty where nothing in it was run."""
    if not systems:
        return ""
    # the paper's table; one without rows of a sense that it does not have
    table = paper_table(name) or {
        "title": f"{to_markdown(name.capitalize())} classification",
        "rows": [],
    }
    best = max(systems, key=lambda system: summarise(system.outcomes)["vote_accuracy"])
    order = [row["model"] for row in table["rows"]]
    lines = []
    for row in table["rows"]:
        found = [item for item in systems if item.model == row["model"] and not item.inside]
        if not found and complete and ("vote" in row or "fragment" in row):
            votes, fragments = _percent(row.get("vote")), _percent(row.get("fragment"))
            start = [row["label"], votes, NOT_RUN, NONE, NONE, fragments, NOT_RUN]
            lines.append([*start, *[NONE] * (len(HEADINGS) - len(start))])
        lines += [_line(row, item, best) for item in found]
    for item in systems:
        if item.inside or item.model not in order:
            lines.append(_line({"label": _label(item)}, item, best))
    data = sorted({item.data for item in systems})
    count = max(len(item.outcomes) for item in systems)
    classes = max(len(item.classes) for item in systems)
    return "\n".join(
        [
            f"### {table['title']}",
            "",
            f"{'Ours' if paper else 'Data'}: {to_markdown(', '.join(data))}, {classes} classes "
            f"(chance {1 / classes:.1%}), {count} test samples."
            + (f" The paper's: {table['data']}." if paper and table["rows"] else ""),
            "",
            *_shown(HEADINGS, lines, paper=paper),
        ]
    )


def conditions_table(systems: Sequence[System]) -> str:
    """Votes by condition of every system, all its runs together; empty without conditions."""
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
    headings = ("condition", "value", *map(to_markdown, known))
    said = (
        "Votes of all runs of a row together, with Wilson's intervals. A row that says unseen was "
        "trained without the conditions that it tested."
    )
    return "\n".join(["### By condition", "", said, "", *markdown(headings, lines)])


def _votes(counts: Mapping[str, Any]) -> str:
    low, high = counts["vote_ci95"]
    share = f"{counts['vote_accuracy']:.1%} ({counts['correct']}/{counts['test_samples']})"
    return f"{share}, {low:.1%} to {high:.1%}"


def rejections_table(systems: Sequence[System]) -> str:
    """What was rejected, a line for each run that was asked to; empty without one."""
    said = [(_label(system), rejections(entry)) for system in systems for entry in system.entries]
    columns = list(dict.fromkeys(fact for _, facts in said for fact in facts))
    lines = [
        [to_markdown(name), *(facts.get(column, NONE) for column in columns)]
        for name, facts in said
        if facts
    ]
    if not lines:
        return ""
    return "\n".join(["### Rejected samples", "", *markdown(["system", *columns], lines)])


def seeds_table(systems: Sequence[System]) -> str:
    """Mean and sample standard deviation of systems that differ in the seed alone."""
    groups: dict[tuple[str, ...], list[System]] = {}
    for system in systems:
        if system.seed:
            key = (system.model, system.kind, system.inside, system.data, system.but_seed)
            groups.setdefault(key, []).append(system)
    lines = [_seeds_line(members) for members in groups.values() if len(members) > 1]
    if not lines:
        return ""
    headings = ("system", "seeds", "votes of each", "mean", "standard deviation")
    return "\n".join(["### Over seeds", "", *markdown(headings, lines)])


def _seeds_line(members: list[System]) -> list[str]:
    runs = [summarise(system.outcomes) for system in members]
    accuracies = [run["vote_accuracy"] for run in runs]
    first = members[0]
    return [
        to_markdown(_label(first) + (f" ({first.but_seed})" if first.but_seed else "")),
        ", ".join(system.seed for system in members),
        ", ".join(f"{run['correct']}/{run['test_samples']}" for run in runs),
        f"{mean(accuracies):.1%}",
        f"{stdev(accuracies):.1%}",
    ]


def _label(system: System) -> str:
    if system.inside:
        return f"{LABELS.get(system.kind, f'{system.kind} network')} inside {system.inside}"
    return system.model


def _line(row: dict[str, Any], system: System, best: System) -> list[str]:
    ours = summarise(system.outcomes)
    low, high = ours["vote_ci95"]
    entries = system.entries
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
        seconds(sum(entry["fit_seconds"] for entry in entries)),
        f"{entries[0]['parameters']:,}",
    ]


def _percent(value: float | None) -> str:
    return NONE if value is None else f"{value:g} %"


def _against(best: System, system: System) -> str:
    """Exact McNemar test against the best row, with both counts of samples only one had right."""
    if system is best:
        return "best"
    test = mcnemar(best.successes, system.successes_beside(best))
    return NONE if test is None else f"{test[2]:.2g} ({test[0]}:{test[1]})"


def markdown(headings: Sequence[str], lines: list[list[str]]) -> list[str]:
    """The lines of a table in Markdown."""
    return [
        f"| {' | '.join(headings)} |",
        f"|{'---|' * len(headings)}",
        *(f"| {' | '.join(cells)} |" for cells in lines),
    ]


def _shown(headings: Sequence[str], lines: list[list[str]], *, paper: bool) -> list[str]:
    """A table in Markdown, with the paper's columns or without."""
    if paper:
        return markdown(headings, lines)
    kept = [n for n, heading in enumerate(headings) if not heading.endswith(PAPER)]
    own = [headings[n].removesuffix(OURS) for n in kept]
    return markdown(own, [[line[n] for n in kept] for line in lines])


def profiling_table(networks: dict[str, dict[str, Any]], *, paper: bool) -> str:
    """Times of dense passes and sliding windows by network, perhaps beside the paper's."""
    theirs = paper_table("profiling")
    lines = [
        [
            to_markdown(name),
            *_paper_times(theirs.get(ours["kind"])),
            f"{ours['sliding_window_ms']:.1f} / {ours['reference_ms']:.1f}",
            f"{ours['speedup']:.1f}x",
            f"{ours['speedup_same_engine']:.1f}x",
            f"{ours['label_agreement']:.1%}",
        ]
        for name, ours in networks.items()
    ]
    headings = (
        "network", "windows / dense (ms), paper", "ratio, paper", "windows / dense (ms), ours",
        "ratio, ours", "ratio in the same engine, ours", "labels equal",
    )  # fmt: skip
    return "\n".join(
        [
            "### Running time",
            "",
            *([f"The paper's: {theirs['device']}. {RATIOS}", ""] if paper else []),
            *_shown(headings, lines, paper=paper),
        ]
    )


def _paper_times(times: dict[str, float] | None) -> list[str]:
    """Both times and their ratio; dashes for a sense that the paper does not have."""
    if times is None:
        return [NONE, NONE]
    windows, dense = times["sliding_window_ms"], times["fcn_ms"]
    return [f"{windows} / {dense}", f"{windows / dense:.1f}x"]
