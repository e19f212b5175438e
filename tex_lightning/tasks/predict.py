"""Classify files with a trained network; one JSON object per sample on standard output."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config, Job
from tex_lightning.core.console import print_line, say
from tex_lightning.data.readers.given_files import find_files, match_files
from tex_lightning.errors import UserError
from tex_lightning.inference.predictor import Predictor
from tex_lightning_runtime.files import expanded, is_file


def run(config: Config, job: Job) -> None:
    """Load the checkpoint once and print a line for each sample.

    Files of several modalities are matched by :func:`.match_files`. Decoding is part of the
    latency. Of a FusionNet that is not given all modalities, its part for those that are there
    decides; with a FusionNet each line says what was looked at. A sample that cannot be classified
    does not stop the others.

    Raises:
        UserError: At the end, naming the samples that could not be classified.
    """
    predictor = Predictor(load_classifier(str(config.checkpoint)), _for_one(config))
    predictor.check_senses(config.files)
    samples = match_files({name: find_files(name, value) for name, value in config.files.items()})
    if config.adapt:
        predictor = adapted(predictor, samples)
    failures = []
    for files in samples:
        recordings: dict[str, Any] = dict(files)
        try:
            prediction = predictor.predict(**recordings)
        except UserError as error:
            if len(samples) == 1:
                raise
            failures.append(str(error))
            continue
        names = {name: str(file) for name, file in files.items()}
        print_line({**names, **prediction.to_dict()})
    if failures:
        count = f"{len(failures)} of {len(samples)} samples could not be classified:"
        raise UserError(count, *failures)


def _for_one(config: Config) -> Config:
    """Return the settings with the CPU for one sample, unless another device was chosen.

    Its label takes less time there than a GPU takes to start.
    """
    single = all(is_file(expanded(str(value))) for value in config.files.values())
    if config.trainer.accelerator != "auto" or not single:
        return config
    return replace(config, trainer=replace(config.trainer, accelerator="cpu"))


def adapted(predictor: Predictor, samples: Sequence[Mapping[str, Path]]) -> Predictor:
    """Return a predictor that is adapted to all samples, and say what was done.

    Raises:
        UserError: If its classifier cannot be adapted.
    """
    # takes as long to import as training
    from tex_lightning.learning.adaptation import adapt, sample_features

    def features() -> Iterator[Tensor]:
        for files in samples:
            with suppress(UserError):  # which its prediction says
                yield from sample_features(predictor.classifier, [predictor.decoded(files)])

    adaptation = adapt(predictor.classifier, features(), predictor.card.unknown_above)
    say(str(adaptation))
    return Predictor(adaptation.classifier, predictor.config)
