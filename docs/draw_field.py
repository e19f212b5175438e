"""The picture of the field, of a report's table: ``python -m docs.draw_field``."""

import re
from pathlib import Path
from typing import Any

import yaml

from benchmarks import _field, accuracy
from tex_lightning.evaluation.outcomes import wilson_interval

DOCS = Path(__file__).parent
REPORT = DOCS / "reports" / "2026-11-26-field.md"
ROW = (
    r"^\| `(\w+)` \| `(\w+)` \| [*`]*([^*`|]+)[*`]* "  # data, protocol, system
    r"\| ([\d.]+) % \D*(\d+)/(\d+).*\| ([\d,.]+) ms \|$"
)


def results(names: dict[str, str]) -> list[dict[str, Any]]:
    """Return the rows of the report's table as results of ``benchmarks accuracy``.

    The interval of a balanced accuracy is that of a share of so many recordings.

    Args:
        names: In the picture, by system; the table has them in bold for the package's own.
    """
    own = {name: system for system, name in names.items()}
    found = re.findall(ROW, REPORT.read_text(encoding="utf-8"), re.MULTILINE)
    cells = []
    for data, protocol, system, percent, correct, tested, ms in found:
        count, score = int(tested), float(percent) / 100
        low, high = wilson_interval(round(score * count), count)
        cells.append({
            "data": data, "protocol": protocol, "system": own.get(system, system),
            "score": score, "ci_low": low, "ci_high": high, "correct": int(correct),
            "latency_ms": float(ms.replace(",", "")),
        })  # fmt: skip
    return cells


if __name__ == "__main__":
    table = Path(accuracy.__file__).with_suffix(".yaml").read_text(encoding="utf-8")
    settings = yaml.safe_load(table)
    _field.draw(settings, results(settings["names"]), DOCS / "field")
