"""Tell the loggers of a network what its test has shown."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
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


def test_pieces(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
) -> Iterator[Piece]:
    """Yield what is seen of a network's test: samples to look at and to hear, and embeddings."""

    def look(number: int) -> ShownSample:
        return show_sample(classifier, samples[number], outcomes[number], store)

    yield from sample_pieces(look, outcomes, classifier.card.classes)
    yield from projector_pieces(classifier, samples, outcomes, store)


def fold_pieces(
    dataset: Dataset, outcomes: Sequence[Outcome], checkpoints: Mapping[str, Path]
) -> Iterator[Piece]:
    """Yield the samples to look at of a cross-validation, each as the network of its fold sees it.

    Args:
        dataset: The recordings of all folds.
        outcomes: Outcomes of all folds.
        checkpoints: File of the network by fold.
    """
    rows = {(row.modality, row.source): row for row in dataset.recordings}
    load = lru_cache(maxsize=2)(load_classifier)

    def look(number: int) -> ShownSample:
        outcome = outcomes[number]
        recordings = {key: rows[key, source] for key, source in outcome.files.items()}
        sample = Sample(outcome.label, recordings)
        return show_sample(load(checkpoints[outcome.fold]), sample, outcome, dataset.store)

    yield from sample_pieces(look, outcomes, dataset.classes)
