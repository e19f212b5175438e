"""Classify files with a trained network; one JSON object per sample on standard output."""

from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.console import print_line
from tex_lightning.errors import UserError
from tex_lightning.inference.evidence import refuse_baseline
from tex_lightning.inference.inputs import find_files, match_files
from tex_lightning.inference.predictor import Predictor

MAX_FAILURES = 20  # that are printed


def run(config: Config, job: Job) -> None:
    """Load the checkpoint once and print a line for each sample.

    Files of several modalities are matched as :func:`.inputs.match_files` says. Decoding is part of
    the latency. Of a FusionNet that is not given all modalities, its part for those that are there
    decides; with a FusionNet each line says what was looked at. A sample that cannot be classified
    does not stop the others. With ``predict.figure`` each is drawn, too.

    Raises:
        UserError: At the end, naming the samples that could not be classified.
    """
    predictor = Predictor(load_classifier(str(config.checkpoint)), config)
    predictor.check_senses(config.files)
    found = {modality: find_files(modality, value) for modality, value in config.files.items()}
    samples, failures = match_files(found), []
    figures = figure_paths(config.predict.figure, samples)
    if config.predict.figure is not None:
        refuse_baseline(predictor.classifier)
    for files, figure in zip(samples, figures, strict=True):
        try:
            said = _classify(predictor, files, figure)
        except UserError as error:
            failures.append(str(error))
            continue
        print_line({**{name: str(file) for name, file in files.items()}, **said})
    if failures:
        raise UserError(*_failed(failures, len(samples)))


def _classify(
    predictor: Predictor, files: Mapping[str, Path], figure: Path | None
) -> dict[str, Any]:
    """What is printed of a sample, which is drawn if there is a file for it."""
    given: dict[str, Any] = dict(files)
    if figure is None:
        return predictor.predict(**given).to_dict()
    found = predictor.explain(**given)
    found.save(figure, ", ".join(path.name for path in files.values()))
    return {**found.prediction.to_dict(), "figure": str(figure)}


def figure_paths(given: str | None, samples: Sequence[Mapping[str, Path]]) -> Sequence[Path | None]:
    """Where each sample is drawn, if at all.

    Of several each has the name of its first file behind that of the figure, or its number where
    files are called alike.
    """
    if given is None:
        return [None] * len(samples)
    path = Path(given).expanduser()
    if len(samples) == 1:
        return [path]
    names = [next(iter(files.values())).stem for files in samples]
    if max(Counter(names).values()) > 1:
        names = [str(number) for number in range(1, len(samples) + 1)]
    return [path.with_name(f"{path.stem}_{name}{path.suffix}") for name in names]


def _failed(failures: list[str], samples: int) -> list[str]:
    if samples == 1:
        return failures
    more = [f"… and {len(failures) - MAX_FAILURES} more"] if len(failures) > MAX_FAILURES else []
    title = f"{len(failures)} of {samples} samples could not be classified:"
    return [title, *failures[:MAX_FAILURES], *more]
