"""Tell the loggers of a network what its test has shown."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cache, lru_cache
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, Folding, plain_values
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.learning.loggers import log_test, trial_settings
from tex_lightning.report.board import Piece, shows
from tex_lightning.report.embeddings import projector_pieces
from tex_lightning.report.errors import Look
from tex_lightning.report.gallery import figure_pieces, pair_pieces, sample_pieces, text_pieces
from tex_lightning.report.samples import ShownSample, show_sample
from tex_lightning.studies.dataset import Dataset
from tex_lightning.studies.description import data_facts


def log_network(
    config: Config,
    dataset: Dataset,
    directory: Path,
    loggers: Sequence[Logger],
    networks: Mapping[str, Any],
    trains: Sequence[Folding] = (),
    further: Iterable[Piece] = (),
) -> None:
    """Log a network that a run has tested, with its figures; of the last one the run's texts, too.

    Args:
        config: The configuration.
        dataset: What it was trained and tested on.
        directory: The run folder, whose figures are drawn.
        loggers: Loggers of the network.
        networks: Entries of ``results.json`` of the networks tested so far, this one the last.
        trains: Divisions that it was trained on, which make it a trial among other trainings; a
            test alone is none.
        further: Further pieces, made where a logger shows any.
    """
    *_, name = networks
    model, values = config.model, plain_values(config)
    pieces: list[Piece] = []
    if showing := shows(loggers):
        pieces += [*figure_pieces(directory, name), *further]
    if showing and (not trains or name == model.kind):
        results = {"classes": dataset.classes, "networks": networks}
        facts = data_facts(config.data, dataset, trains)
        pieces += text_pieces(directory, results, facts)
        pieces += pair_pieces(directory, networks, dataset.classes)
    trial = trial_settings(directory, model.name, config.data.name, name) if trains else None
    told = values if trains else {key: values[key] for key in ("seed", "data")}
    log_test(loggers, name, told, networks[name], pieces, trial)


def looking(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
) -> Look:
    """Return what looks at each test sample of a network once."""

    @cache
    def look(number: int) -> ShownSample:
        return show_sample(classifier, samples[number], outcomes[number], store)

    return look


def test_pieces(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
    look: Look,
) -> Iterator[Piece]:
    """Yield what is seen of a network's test: samples to look at and to hear, and embeddings."""
    yield from sample_pieces(look, outcomes, classifier.card.classes)
    yield from projector_pieces(classifier, samples, outcomes, store)


def fold_samples(dataset: Dataset, outcomes: Sequence[Outcome]) -> list[Sample]:
    """Return the samples of the outcomes of all folds."""
    rows = {(row.modality, row.source): row for row in dataset.recordings}
    return [
        Sample(outcome.label, {key: rows[key, file] for key, file in outcome.files.items()})
        for outcome in outcomes
    ]


def looking_by_fold(
    dataset: Dataset,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    checkpoints: Mapping[str, Path],
) -> Look:
    """Return what looks at each sample of a cross-validation as the network of its fold does.

    Args:
        dataset: The recordings of all folds.
        samples: The samples.
        outcomes: Outcomes of all folds.
        checkpoints: File of the network by fold.
    """
    load = lru_cache(maxsize=2)(load_classifier)

    @cache
    def look(number: int) -> ShownSample:
        outcome = outcomes[number]
        return show_sample(load(checkpoints[outcome.fold]), samples[number], outcome, dataset.store)

    return look
