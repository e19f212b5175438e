"""Collect the artifacts of a run for its loggers: figures, samples and texts."""

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.core.files import read_record
from tex_lightning.evaluation.confusion import own_pairs
from tex_lightning.evaluation.outcomes import read_networks
from tex_lightning.report.artifacts import Picture, Sound, Words, jpeg
from tex_lightning.report.data_page import FILE, data_facts
from tex_lightning.report.pictures import captioned
from tex_lightning.report.samples import SampleView, sample_picture, worst
from tex_lightning.report.table import fact_rows, markdown, typed_overrides
from tex_lightning.text import printable, to_markdown

WORST = 6  # samples, as far as there are errors
MIN_SHOWN = 3  # of which those that are right are the least sure
# Tags of the figures that a test draws, by the end of their file's name.
FIGURES = {
    "confusion": "confusion/recordings",
    "confusion_fragments": "confusion/fragments",
    "classes": "histogram/fragment accuracy by class",
    "calibration": "reliability/recordings",
}


def figure_artifacts(directory: Path, network: str) -> Iterator[Picture]:
    """Yield the figures of a network in the run folder, as they were saved."""
    for file in sorted((directory / "figures").glob(f"{network}_*.png")):
        name = file.stem.removeprefix(f"{network}_")
        yield Picture(FIGURES.get(name, f"figures/{name}"), file.read_bytes())


def text_artifacts(directory: Path, results: Mapping[str, Any]) -> Iterator[Words]:
    """Yield the command of a run, what its data are and its results."""
    command = shlex.join(["python", "-m", "tex_lightning", *typed_overrides(directory)])
    yield Words("1 command", f"    {printable(command)}")
    data = data_facts(read_record(directory / FILE))
    yield Words("2 data", _table([["data", ""], *map(list, data)]))
    yield Words("3 results", _table(fact_rows(results)))


def _table(rows: list[list[str]]) -> str:
    first, *others = [[to_markdown(cell) for cell in row] for row in rows]
    return "\n".join(markdown(first, others))


def sample_artifacts(view: SampleView) -> Iterator[Picture | Sound]:
    """Yield the worst samples, and both sides of the most confused pairs with their sounds."""
    most = min(WORST, max(view.errors, MIN_SHOWN))
    for place, number in enumerate(worst(view.outcomes, most), 1):
        sample = view.look(number)
        yield Picture(
            f"worst samples/{place} {printable(sample.title)}", jpeg(sample_picture(sample))
        )
    for place, (pair, numbers) in enumerate(view.pairs(), 1):
        sides = [view.look(number) for number in numbers]
        title = printable(f"{place} {pair.label} called {pair.predicted}")
        pictures = [sample_picture(side) for side in sides]
        said = f"{pair.share:.0%} of the fragments of {pair.label} are called {pair.predicted}"
        yield Picture(f"confused pairs/{title}", jpeg(captioned([(said, pictures)])))
        for side in sides:
            for name, sense in side.senses.items():
                if sense.sound is not None:
                    tag = f"confused pairs/{title}: {name} of {printable(side.outcome.label)}"
                    yield Sound(tag, *sense.sound)


def pair_artifacts(
    directory: Path, networks: Iterable[str], classes: Sequence[str]
) -> Iterator[Words]:
    """Yield a table of the pairs that one network confuses and another one tells apart."""
    rows = [
        [own.network, own.pair.label, own.pair.predicted, f"{own.pair.share:.0%}",
         ", ".join(f"{name} {share:.0%}" for name, share in own.others.items())]
        for own in own_pairs(read_networks(directory, networks), classes)
    ]  # fmt: skip
    if rows:
        heading = ["network", "fragments of", "called", "share", "share of other networks"]
        yield Words("4 confused pairs", _table([heading, *rows]))
