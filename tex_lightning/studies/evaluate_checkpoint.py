"""Test a checkpoint: outcomes, ``results.json``, figures, and what its loggers show."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger

from tex_lightning.classifier.card import CROSSVAL
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, Folding, plain_values
from tex_lightning.core.devices import computing_device
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store, Unusable, load_sample, skipped_entry
from tex_lightning.evaluation.conditions import by_condition
from tex_lightning.evaluation.confusion import fragment_counts
from tex_lightning.evaluation.metrics import pooled_metrics
from tex_lightning.evaluation.novelty import report_unknown
from tex_lightning.evaluation.outcomes import (
    Outcome,
    environment,
    run_test,
    vote_counts,
    write_outcomes,
)
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.inference.engine import sample_macs
from tex_lightning.inference.prediction import warn_of_few
from tex_lightning.learning.loggers import log_test, trial_settings
from tex_lightning.report.artifacts import Artifact, shows
from tex_lightning.report.data_page import facts_of
from tex_lightning.report.figures import (
    calibration_figure,
    confusion_figure,
    recall_figure,
    save_figure,
)
from tex_lightning.report.gallery import (
    figure_artifacts,
    pair_artifacts,
    projector_artifacts,
    sample_artifacts,
    text_artifacts,
)
from tex_lightning.report.misclassified import SampleView, keep_samples
from tex_lightning.report.samples import ShownSample, show_sample
from tex_lightning.studies.dataset import Dataset
from tex_lightning.studies.description import describe_data

MIN_CALIBRATED = 50  # samples from which a calibration is drawn


def results_frame(
    config: Config,
    model: str,
    classes: list[str],
    skipped: Sequence[Unusable],
    networks: dict[str, Any],
    seconds: float,
    *,
    baseline: bool = False,
) -> dict[str, Any]:
    """Return the entries of ``results.json`` around its networks, or around a baseline."""
    return {
        "task": config.task,
        "model": model,
        "data": config.data.name,
        "classes": classes,
        "seed": config.seed,
        "wall_seconds": seconds,
        "skipped": skipped_entry(skipped),
        "environment": environment(
            computing_device(config.trainer.accelerator, [baseline]), config.trainer
        ),
        "networks": networks,
    }


def describe_network(
    classifier: SurfaceClassifier, checkpoint: Path, sample: Sample, store: Store
) -> dict[str, Any]:
    """Return what an entry of ``results.json`` has beside the test."""
    training, recordings = classifier.card.training, load_sample(sample, store)
    return {
        "parameters": classifier.count_parameters(),
        # None for a baseline whose arithmetic is outside PyTorch and not counted
        "macs_per_sample": sample_macs(classifier, **recordings) or None,
        "fit_seconds": training.get("fit_seconds", 0.0),
        "val_loss": training.get("val_loss"),
        "checkpoint": str(checkpoint.resolve()),
        **({CROSSVAL: training[CROSSVAL]} if training.get(CROSSVAL) else {}),
    }


def report_network(
    config: Config,
    dataset: Dataset,
    classifier: SurfaceClassifier,
    checkpoint: Path,
    samples: Sequence[Sample],
    unknown: Sequence[Sample],
    directory: Path,
) -> tuple[dict[str, Any], list[Outcome]]:
    """Test a network as prediction runs it; write its predictions into the run folder.

    Returns:
        Its entry of ``results.json``, and what became of each sample.
    """
    kind, store = classifier.card.kind, dataset.store
    warn_of_few(classifier.card.deciding(config.decision))
    decider = make_inference_model(classifier, config.engine, config.decision)
    fold = None if config.data.test_where else config.data.test_fold
    outcomes = run_test(decider, samples, store, fold)
    write_outcomes(outcomes, directory / "predictions" / f"{kind}.csv")
    entry = {
        **pooled_metrics(outcomes),
        **by_condition(samples, outcomes, dataset.condition_bins),
        **describe_network(classifier, checkpoint, samples[0], store),
        **report_unknown(decider, unknown, store, directory, outcomes, fold),
    }
    return entry, outcomes


def draw_figures(
    outcomes: Sequence[Outcome],
    classes: list[str],
    name: str,
    directory: Path,
) -> None:
    """Save confusions of recordings and of fragments, recall by class, and calibration.

    Calibration is drawn from 50 samples on: 15 bins of fewer say nothing.
    """
    samples = f"{name}: {len(outcomes)} test samples"
    fragments = fragment_counts(outcomes, classes)
    counted = f"{name}: {fragments.sum():,} fragments"
    figures = {
        "confusion": confusion_figure(vote_counts(outcomes, classes), classes, samples),
        "confusion_fragments": confusion_figure(fragments, classes, counted),
        "classes": recall_figure(fragments, classes, counted),
    }
    if len(outcomes) >= MIN_CALIBRATED:
        figures["calibration"] = calibration_figure(outcomes, name)
    for title, figure in figures.items():
        save_figure(figure, directory / "figures" / f"{name}_{title}")


def log_network(
    config: Config,
    dataset: Dataset,
    directory: Path,
    loggers: Sequence[Logger],
    networks: Mapping[str, Any],
    trains: Sequence[Folding] = (),
    further: Iterable[Artifact] = (),
) -> None:
    """Log a network that a run has tested, with its figures; of the last one the run's texts, too.

    Args:
        config: The configuration.
        dataset: What it was trained and tested on.
        directory: The run folder, whose figures are drawn.
        loggers: Loggers of the network.
        networks: Entries of ``results.json`` of the networks tested so far, this one the last.
        trains: Divisions that it was trained on; empty if the run only tests. TensorBoard compares
            trainings with each other.
        further: Further artifacts, made only if a logger shows any.
    """
    *_, name = networks
    model, values = config.model, plain_values(config)
    artifacts: list[Artifact] = []
    if showing := shows(loggers):
        artifacts += [*figure_artifacts(directory, name), *further]
    if showing and (not trains or name == model.kind):
        results = {"classes": dataset.classes, "networks": networks}
        facts = facts_of(describe_data(config.data, dataset, trains))
        artifacts += text_artifacts(directory, results, facts)
        artifacts += pair_artifacts(directory, networks, dataset.classes)
    trial = trial_settings(directory, model.name, config.data.name, name) if trains else None
    settings = values if trains else {key: values[key] for key in ("seed", "data")}
    log_test(loggers, name, settings, networks[name], artifacts, trial)


def view_samples(
    classifier_of: Callable[[Outcome], SurfaceClassifier],
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
) -> SampleView:
    """Return a function that renders the test sample of a number, each once.

    Args:
        classifier_of: Returns the network that gave an outcome, such as that of its fold.
        samples: The samples.
        outcomes: What became of them.
        store: Their recordings.
    """

    @cache
    def look(number: int) -> ShownSample:
        outcome = outcomes[number]
        return show_sample(classifier_of(outcome), samples[number], outcome, store)

    return look


def draw_test(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
    directory: Path,
) -> Iterator[Artifact]:
    """Save the figures and the misclassified samples of a test in the run folder.

    Returns:
        The artifacts for its loggers, made when they are asked for: samples and embeddings.
    """
    card, view = classifier.card, view_samples(lambda _: classifier, samples, outcomes, store)
    draw_figures(outcomes, card.classes, card.kind, directory)
    keep_samples(directory, card.kind, view, outcomes, samples, card.classes)
    embeddings = projector_artifacts(classifier, samples, outcomes, store)
    return chain(sample_artifacts(view, outcomes, card.classes), embeddings)


def fold_samples(dataset: Dataset, outcomes: Sequence[Outcome]) -> list[Sample]:
    """Return the samples of the outcomes of all folds."""
    rows = {(row.modality, row.source): row for row in dataset.recordings}
    return [
        Sample(outcome.label, {key: rows[key, file] for key, file in outcome.files.items()})
        for outcome in outcomes
    ]
