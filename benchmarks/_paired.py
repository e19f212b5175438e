"""Two results on the same recordings: what was lost, its interval, and one table of it."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from tex_lightning.evaluation.comparison import mcnemar
from tex_lightning.text import to_markdown

UNCHANGED = "unchanged"
SIGNIFICANT, NORMAL = 0.05, 1.96  # level of the test, and quantile of the interval
COLUMNS = ("set", "shape", "model", "base", "correct", "tested", "paired", "lost", "gained",
           "difference", "low", "high", "p", "fit_seconds", "said")  # fmt: skip
Node = dict[str, Any]


class Cell(NamedTuple):
    """One shape of one data set, classified by one model, and the shape to compare it with."""

    set: str
    shape: str
    model: str
    base: str = UNCHANGED


def compare(results: Mapping[Cell, Node]) -> list[Node]:
    """Return a line for each cell: what it lost and gained of the recordings that its base has.

    Args:
        results: By cell what was ``said``; of one that was tested ``outcomes``, the class and the
            predicted one by the key of each recording, and ``fit_seconds``.
    """
    outcomes = {cell[:3]: result.get("outcomes", {}) for cell, result in results.items()}
    lines = []
    for cell, result in results.items():
        own, before = outcomes[cell[:3]], outcomes.get((cell.set, cell.base, cell.model), {})
        hits = {key: label == predicted for key, (label, predicted) in own.items()}
        pairs = [(before[key][0] == before[key][1], hits[key]) for key in hits if key in before]
        lost, gained, p = mcnemar(*zip(*pairs, strict=True)) if pairs else (0, 0, 1.0)
        difference, low, high = paired_interval(lost, gained, len(pairs))
        lines.append({
            **cell._asdict(), "tested": len(own), "correct": sum(hits.values()),
            "paired": len(pairs), "lost": lost, "gained": gained, "p": p,
            "difference": difference, "low": low, "high": high,
            "fit_seconds": result.get("fit_seconds", math.nan), "said": result["said"],
        })  # fmt: skip
    return lines


def paired_interval(lost: int, gained: int, count: int) -> tuple[float, float, float]:
    """Return the difference of two paired shares, and its 95 % interval.

    The interval is Wald's with half a pair added to each of the four cells, which holds its level
    for few and for no differences, too (Agresti and Min 2005).
    """
    if not count:
        return 0.0, -1.0, 1.0
    total, change = count + 2, gained - lost
    centre = change / total
    half = NORMAL * math.sqrt(lost + gained + 1 - change**2 / total) / total
    return change / count, max(-1.0, centre - half), min(1.0, centre + half)


def lost_significantly(line: Node) -> bool:
    """Return whether a cell has fewer correct than its base, and not by chance."""
    return bool(line["p"] < SIGNIFICANT and line["lost"] > line["gained"])


def shown(line: Node) -> str:
    """Return a line in words: counts, difference in per cent and its interval."""
    if not line["tested"]:
        return to_markdown(" ".join(str(line["said"]).splitlines()[:2]))  # of many files the first
    counts = f"{line['correct']}/{line['tested']}"
    if line["shape"] == UNCHANGED or not line["paired"]:
        return counts
    difference, low, high = (100 * line[name] for name in ("difference", "low", "high"))
    text = f"{counts}, {difference:+.1f} ({low:+.1f} to {high:+.1f})"
    return f"**{text}**" if lost_significantly(line) else text


def to_table(lines: Sequence[Node], earlier: Sequence[Node] = ()) -> str:
    """Return one table as Markdown: a row for each set and shape, a column for each model.

    Args:
        lines: Results.
        earlier: Those of another version, whose columns come before.
    """
    texts: dict[str, dict[tuple[str, str], str]] = defaultdict(dict)
    for title, own in ((" before", earlier), ("", lines)):
        for line in own:
            texts[f"{line['model']}{title}"][line["set"], line["shape"]] = shown(line)
    models = dict.fromkeys(line["model"] for line in lines)
    names = [name for model in models for name in (f"{model} before", model) if name in texts]
    rows = [["set", "shape", *names], ["---"] * (2 + len(names))]
    for key, base in {(x["set"], x["shape"]): x["base"] for x in lines}.items():
        than = "" if base == UNCHANGED else f" (than {base})"
        cells = [texts[name].get(key, "") for name in names]
        rows.append([key[0], key[1] + than, *cells])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)
