"""Collect the artifacts of a run for its loggers: figures, samples and texts."""

import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.evaluation.confusion import confused_pairs, own_pairs
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes
from tex_lightning.report.artifacts import Picture, Sound, Words, jpeg
from tex_lightning.report.pictures import captioned
from tex_lightning.report.samples import ShownSample, sample_picture, worst
from tex_lightning.report.table import facts, markdown, typed_overrides
from tex_lightning.text import printable, to_markdown

WORST = 6  # samples, as far as there are errors
MIN_SHOWN = 3  # of which those that are right are the least sure
PAIRS = 3
# Tags of the figures that a test draws, by the end of their file's name.
FIGURES = {
    "confusion": "confusion/recordings",
    "confusion_fragments": "confusion/fragments",
    "classes": "histogram/fragment accuracy by class",
    "pairs": "pairs/most confused",
    "calibration": "reliability/recordings",
}


def figure_artifacts(directory: Path, network: str) -> Iterator[Picture]:
    """Yield the figures of a network in the run folder, as they were saved."""
    for file in sorted((directory / "figures").glob(f"{network}_*.png")):
        name = file.stem.removeprefix(f"{network}_")
        yield Picture(FIGURES.get(name, f"figures/{name}"), file.read_bytes())


def text_artifacts(
    directory: Path, results: Mapping[str, Any], data: Mapping[str, str]
) -> Iterator[Words]:
    """Yield the command of a run, what its data are and its results."""
    command = shlex.join(["python", "-m", "tex_lightning", *typed_overrides(directory)])
    yield Words("1 command", f"    {printable(command)}")
    yield Words("2 data", _table([["data", ""], *map(list, data.items())]))
    shown = facts(results)
    rows = {fact: None for network in shown.values() for fact in network}
    cells = [[fact, *(network.get(fact, "") for network in shown.values())] for fact in rows]
    yield Words("3 results", _table([["", *shown], *cells]))


def _table(rows: list[list[str]]) -> str:
    first, *others = [[to_markdown(cell) for cell in row] for row in rows]
    return "\n".join(markdown(first, others))


def sample_artifacts(
    look: Callable[[int], ShownSample], outcomes: Sequence[Outcome], classes: Sequence[str]
) -> Iterator[Picture | Sound]:
    """Yield the worst samples, and both sides of the most confused pairs with their sounds."""
    errors = sum(outcome.label != outcome.predicted for outcome in outcomes)
    for place, number in enumerate(worst(outcomes, min(WORST, max(errors, MIN_SHOWN))), 1):
        sample = look(number)
        yield Picture(
            f"worst samples/{place} {printable(sample.title)}", jpeg(sample_picture(sample))
        )
    for place, pair in enumerate(confused_pairs(outcomes, classes)[:PAIRS], 1):
        sides = [
            look(number)
            for number in (
                side_of(outcomes, pair.label, pair.predicted),
                side_of(outcomes, pair.predicted),
            )
            if number is not None
        ]
        title = printable(f"{place} {pair.label} called {pair.predicted}")
        pictures = [sample_picture(side) for side in sides]
        said = f"{pair.share:.0%} of the fragments of {pair.label} are called {pair.predicted}"
        yield Picture(f"confused pairs/{title}", jpeg(captioned([(said, pictures)])))
        for side in sides:
            for name, sense in side.senses.items():
                if sense.sound is not None:
                    tag = f"confused pairs/{title}: {name} of {printable(side.outcome.label)}"
                    yield Sound(tag, *sense.sound)


def side_of(outcomes: Sequence[Outcome], label: str, predicted: str | None = None) -> int | None:
    """Return the number of the sample of a class that is most for another, or most for its own."""
    numbers = [number for number, outcome in enumerate(outcomes) if outcome.label == label]
    if not numbers:
        return None
    other = label if predicted is None else predicted

    def likely(number: int) -> tuple[bool, float]:
        outcome = outcomes[number]
        return outcome.predicted == other, outcome.class_probabilities.get(other, 0.0)

    return max(numbers, key=likely)


def pair_artifacts(
    directory: Path, networks: Iterable[str], classes: Sequence[str]
) -> Iterator[Words]:
    """Yield a table of the pairs that one network confuses and another one tells apart."""
    files = {name: directory / "predictions" / f"{name}.csv" for name in networks}
    outcomes = {name: read_outcomes(file) for name, file in files.items() if file.is_file()}
    rows = [
        [own.network, own.pair.label, own.pair.predicted, f"{own.pair.share:.0%}",
         ", ".join(f"{name} {share:.0%}" for name, share in own.others.items())]
        for own in own_pairs(outcomes, classes)
    ]  # fmt: skip
    if rows:
        heading = ["network", "fragments of", "called", "share", "share of other networks"]
        yield Words("4 confused pairs", _table([heading, *rows]))
