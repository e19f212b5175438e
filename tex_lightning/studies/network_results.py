"""Test a checkpoint: outcomes, ``results.json``, figures, and what its loggers show."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

from lightning.pytorch.loggers import Logger

from tex_lightning.classifier.card import CROSSVAL
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, plain_values
from tex_lightning.core.devices import computing_device
from tex_lightning.core.environment import environment
from tex_lightning.core.run_folder import predictions_of
from tex_lightning.data.folds import Sample, make_samples
from tex_lightning.data.store import Store, load_sample, skipped_entry
from tex_lightning.evaluation.conditions import by_condition
from tex_lightning.evaluation.confusion import fragment_counts, vote_counts
from tex_lightning.evaluation.metrics import pooled_metrics
from tex_lightning.evaluation.novelty import report_unknown
from tex_lightning.evaluation.outcomes import Outcome, run_test, write_outcomes
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.inference.engine import sample_macs
from tex_lightning.inference.prediction import warn_of_few
from tex_lightning.learning.loggers import log_test, trial_settings
from tex_lightning.report.artifacts import Artifact, shows
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
from tex_lightning.report.misclassified import keep_samples
from tex_lightning.report.samples import SampleView
from tex_lightning.studies.dataset import Dataset

MIN_CALIBRATED = 50  # samples from which a calibration is drawn


def run_facts(config: Config, seconds: float, baselines: Iterable[bool]) -> dict[str, Any]:
    """Return what ``results.json`` says of a run beside its results.

    Args:
        config: The configuration.
        seconds: Time that the run took.
        baselines: Of each classifier of the run, whether it is a baseline.
    """
    device = computing_device(config.trainer.accelerator, baselines)
    return {
        "task": config.task,
        "data": config.data.name,
        "seed": config.seed,
        "wall_seconds": seconds,
        "environment": environment(device, config.trainer.precision),
    }


def results_frame(
    config: Config,
    model: str,
    dataset: Dataset,
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
        "classes": dataset.classes,
        **run_facts(config, seconds, [baseline]),
        "skipped": skipped_entry(dataset.skipped),
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
    tested: Dataset,
    classifier: SurfaceClassifier,
    checkpoint: Path,
    directory: Path,
    *,
    draw: bool,
) -> tuple[dict[str, Any], Iterable[Artifact]]:
    """Test a network as prediction runs it; write its predictions into the run folder.

    If ``draw``, its figures and misclassified samples are written, too.

    Returns:
        Its entry of ``results.json``; and samples and embeddings for its loggers, made when they
        are asked for.
    """
    card, store = classifier.card, tested.store
    samples, unknown = (
        make_samples(rows, card.modalities) for rows in (tested.recordings, tested.unknown)
    )
    warn_of_few(card.deciding(config.decision))
    decider = make_inference_model(classifier, config.engine, config.decision)
    fold = None if config.data.test_where else config.data.test_fold
    outcomes = run_test(decider, samples, store, fold)
    write_outcomes(outcomes, predictions_of(directory, card.kind))
    entry = {
        **pooled_metrics(outcomes),
        **by_condition(samples, outcomes, tested.condition_bins),
        **describe_network(classifier, checkpoint, samples[0], store),
        **report_unknown(decider, unknown, store, directory, outcomes, fold),
    }
    if not draw:
        return entry, ()
    view = SampleView(lambda _: classifier, card.classes, samples, outcomes, store)
    draw_figures(outcomes, card.classes, card.kind, directory)
    keep_samples(directory, card.kind, view)
    return entry, chain(sample_artifacts(view), projector_artifacts(classifier, view))


def draw_figures(
    outcomes: Sequence[Outcome], classes: list[str], name: str, directory: Path
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
    classes: Sequence[str],
    directory: Path,
    loggers: Sequence[Logger],
    networks: Mapping[str, Any],
    further: Iterable[Artifact] = (),
    *,
    trained: bool,
) -> None:
    """Log a network that a run has tested, with its figures; of the last one the run's texts, too.

    Args:
        config: The configuration.
        classes: Classes of the data.
        directory: The run folder, which has the figures and the description of the data.
        loggers: Loggers of the network.
        networks: Entries of ``results.json`` of the networks tested so far, this one the last.
        further: Further artifacts, made only if a logger shows any.
        trained: Whether the run has trained it: TensorBoard compares trainings with each other.
    """
    *_, name = networks
    model, values = config.model, plain_values(config)
    artifacts: list[Artifact] = []
    if showing := shows(loggers):
        artifacts += [*figure_artifacts(directory, name), *further]
    if showing and (not trained or name == model.kind):
        artifacts += text_artifacts(directory, {"classes": classes, "networks": networks})
        artifacts += pair_artifacts(directory, networks, classes)
    trial = trial_settings(directory, model.name, config.data.name, name) if trained else None
    settings = values if trained else {key: values[key] for key in ("seed", "data")}
    log_test(loggers, name, settings, networks[name], artifacts, trial)


def fold_samples(dataset: Dataset, outcomes: Sequence[Outcome]) -> list[Sample]:
    """Return the samples of the outcomes of all folds."""
    rows = {(row.modality, row.source): row for row in dataset.recordings}
    return [
        Sample(outcome.label, {key: rows[key, file] for key, file in outcome.files.items()})
        for outcome in outcomes
    ]
