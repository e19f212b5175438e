"""Classify files with a trained network; one JSON object per sample on standard output."""

from typing import cast

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.job import Job
from tex_lightning.errors import UserError
from tex_lightning.inference.inputs import find_files, pair_files
from tex_lightning.lines import print_line
from tex_lightning.predictor import Predictor

MAX_FAILURES = 20  # that are printed


def run(config: Config, job: Job) -> None:
    """Load the checkpoint once and print a line for each sample.

    Several traces and photos are paired as :func:`.inputs.pair_files` says. Decoding is part of the
    latency. Of a FusionNet that is given one modality, its part for that modality decides; with a
    FusionNet each line says what was looked at. A sample that cannot be classified does not stop
    the others.

    Raises:
        UserError: At the end, naming the samples that could not be classified.
    """
    predictor = Predictor(load_classifier(cast(str, config.checkpoint)), config)
    samples = pair_files(find_files("haptic", config.haptic), find_files("image", config.image))
    predictor.check_senses(haptic=samples[0][0] is not None, image=samples[0][1] is not None)
    failures: list[str] = []
    for haptic, image in samples:
        try:
            prediction = predictor.predict(haptic, image)
        except UserError as error:
            failures.append(str(error))
            continue
        given = {"haptic": haptic, "image": image}
        files = {key: str(file) for key, file in given.items() if file is not None}
        print_line({**files, **prediction.to_dict()})
    if failures:
        raise UserError(_failed(failures, len(samples)))


def _failed(failures: list[str], samples: int) -> str:
    if samples == 1:
        return failures[0]
    more = [f"… and {len(failures) - MAX_FAILURES} more"] if len(failures) > MAX_FAILURES else []
    title = f"{len(failures)} of {samples} samples could not be classified:"
    return "\n".join([title, *failures[:MAX_FAILURES], *more])
