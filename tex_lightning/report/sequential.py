"""Cost and agreement of sequential decisions over their thresholds."""

import csv
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path
from typing import Any

import matplotlib.ticker
from matplotlib.figure import Figure

from tex_lightning.report.results import wilson_interval


@dataclass(frozen=True)
class Setting:
    """What one threshold gave on the test samples.

    Attributes:
        network: haptic, visual or fusion.
        knob: ``alpha``, ``enough``, or ``used`` for the thresholds that the run was asked for.
        value: Of the threshold; for ``used`` that of alpha.
        test_samples: Their number.
        correct: Right votes.
        agreed: Votes that are those of the full decision.
        evidence: Mean share of the full decision's arithmetic.
        fragments: Mean number of fragments.
    """

    network: str
    knob: str
    value: float
    test_samples: int
    correct: int
    agreed: int
    evidence: float
    fragments: float

    @property
    def place(self) -> tuple[str, str, float]:
        """Network, knob and value."""
        return self.network, self.knob, self.value


def pool(settings: Iterable[Setting]) -> list[Setting]:
    """Add up the same thresholds over folds."""
    pooled: dict[tuple[str, str, float], Setting] = {}
    for new in settings:
        old = pooled.get(new.place)
        pooled[new.place] = new if old is None else _sum(old, new)
    return list(pooled.values())


def _sum(old: Setting, new: Setting) -> Setting:
    count = old.test_samples + new.test_samples
    share = new.test_samples / count
    return replace(
        old,
        test_samples=count,
        correct=old.correct + new.correct,
        agreed=old.agreed + new.agreed,
        evidence=(1 - share) * old.evidence + share * new.evidence,
        fragments=(1 - share) * old.fragments + share * new.fragments,
    )


def summarise_sequential(used: Setting) -> dict[str, Any]:
    """The entry of ``results.json``."""
    count = used.test_samples
    return {
        "evidence": used.evidence,
        "fragments": used.fragments,
        "accuracy": used.correct / count,
        "agreement": used.agreed / count,
        "agreement_ci95": wilson_interval(used.agreed, count),
    }


def write_settings(settings: Sequence[Setting], path: Path) -> None:
    """Write as CSV, in place of what is there of the same networks."""
    networks = {item.network for item in settings}
    kept = [item for item in read_settings(path) if item.network not in networks]
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(entry.name for entry in fields(Setting))
        writer.writerows(astuple(item) for item in [*kept, *settings])


def read_settings(path: Path) -> list[Setting]:
    """Read what :func:`write_settings` wrote; nothing if there is no file."""
    if not path.is_file():
        return []
    types = {entry.name: entry.type for entry in fields(Setting)}
    with path.open(newline="", encoding="utf-8") as stream:
        return [
            Setting(**{key: types[key](value) for key, value in line.items()})  # type: ignore[operator]
            for line in csv.DictReader(stream)
        ]


def sequential_figure(settings: Sequence[Setting], title: str) -> Figure:
    """Agreement and accuracy against the share of the arithmetic, a line for each knob."""
    figure = Figure(figsize=(9, 4), layout="constrained")
    for axes, name in zip(figure.subplots(1, 2, sharex=True), ("agreed", "correct"), strict=True):
        for knob, colour in (("alpha", "#4477aa"), ("enough", "#cc6677"), ("used", "#222222")):
            line = sorted(
                (item for item in settings if item.knob == knob), key=lambda item: item.evidence
            )
            shares = [getattr(item, name) / item.test_samples for item in line]
            marks = "*" if knob == "used" else "o-"
            if line:
                axes.plot([item.evidence for item in line], shares, marks, color=colour, label=knob)
            for item, share in zip(line, shares, strict=True):
                if knob != "used":
                    axes.annotate(f"{item.value:g}", (item.evidence, share), fontsize=6)
        axes.yaxis.set_major_formatter(matplotlib.ticker.PercentFormatter(1, decimals=1))
        axes.set(xlabel="arithmetic, share of the full decision's")
        axes.set_ylabel("same label as the full decision" if name == "agreed" else "right votes")
        axes.legend()
    figure.suptitle(title)
    return figure
