"""Classify files with a trained network; one JSON object per sample on standard output."""

from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.job import Job
from tex_lightning.errors import UserError
from tex_lightning.inference.inputs import find_files, match_files
from tex_lightning.lines import print_line
from tex_lightning.predictor import Predictor

MAX_FAILURES = 20  # that are printed


def run(config: Config, job: Job) -> None:
    """Load the checkpoint once and print a line for each sample.

    Files of several modalities are matched as :func:`.inputs.match_files` says. Decoding is part of
    the latency. Of a FusionNet that is not given all modalities, its part for those that are there
    decides; with a FusionNet each line says what was looked at. A sample that cannot be classified
    does not stop the others.

    Raises:
        UserError: At the end, naming the samples that could not be classified.
    """
    predictor = Predictor(load_classifier(str(config.checkpoint)), config.prediction)
    predictor.check_senses(config.files)
    found = {modality: find_files(modality, value) for modality, value in config.files.items()}
    samples, failures = match_files(found), []
    for files in samples:
        given: dict[str, Any] = dict(files)
        try:
            prediction = predictor.predict(**given)
        except UserError as error:
            failures.append(str(error))
            continue
        print_line({**{name: str(file) for name, file in files.items()}, **prediction.to_dict()})
    if failures:
        raise UserError(_failed(failures, len(samples)))


def _failed(failures: list[str], samples: int) -> str:
    if samples == 1:
        return failures[0]
    more = [f"… and {len(failures) - MAX_FAILURES} more"] if len(failures) > MAX_FAILURES else []
    title = f"{len(failures)} of {samples} samples could not be classified:"
    return "\n".join([title, *failures[:MAX_FAILURES], *more])
