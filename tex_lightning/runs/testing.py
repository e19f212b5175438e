"""Test a checkpoint sample by sample, as prediction classifies them, and write the outcomes."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tex_lightning.classifier.classifier import SurfaceClassifier, Trained
from tex_lightning.config import Config
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store, load_sample
from tex_lightning.evaluation.calibration import calibration, selective
from tex_lightning.evaluation.conditions import by_condition
from tex_lightning.evaluation.novelty import report_unknown
from tex_lightning.evaluation.outcomes import Outcome, summarise, vote_counts, write_outcomes
from tex_lightning.evaluation.samples import run_test
from tex_lightning.inference.costs import count_macs
from tex_lightning.inference.early_stopping import SequentialClassifier, make_inference_model
from tex_lightning.inference.unknown import warn_of_few
from tex_lightning.report.confusion import class_accuracy_figure, confusion_figure
from tex_lightning.report.figures import calibration_figure, save_figure
from tex_lightning.runs.sequential import report_sequential


def report_network(
    trained: Trained,
    samples: Sequence[Sample],
    store: Store,
    directory: Path,
    config: Config,
    unknown: Sequence[Sample] = (),
) -> tuple[dict[str, Any], list[Outcome]]:
    """Test a network as prediction runs it; write its predictions into the run folder.

    Args:
        trained: The network, on its device.
        samples: What is tested, at least one.
        store: Their recordings.
        directory: The run folder.
        config: How it runs and decides.
        unknown: Samples of classes that were held out.

    Returns:
        Its entry of ``results.json``, and what became of each sample.
    """
    classifier = trained.classifier
    kind, classes = classifier.card.kind, classifier.card.classes
    warn_of_few(classifier.card.deciding(config.decision))
    decider = make_inference_model(classifier, config.engine, config.decision)
    fold = None if config.data.test_where else config.data.test_fold
    outcomes = run_test(decider, samples, store, fold)
    write_outcomes(outcomes, directory / "predictions" / f"{kind}.csv")
    entry = {
        **summarise(outcomes),
        **by_condition(samples, outcomes),
        **calibration_metrics(outcomes, classes, decider.card.reject_below),
        **network_facts(classifier, samples[0], store),
        "fit_seconds": trained.fit_seconds,
        "val_loss": trained.val_loss,  # None where nothing was validated
        "checkpoint": str(trained.checkpoint.resolve()),
    }
    drawn = config.decision.alphas or config.decision.confidence_thresholds
    if isinstance(decider, SequentialClassifier) and drawn:
        entry["sequential"] = report_sequential(
            decider, config.decision, samples, store, directory, config.figures.formats
        )
    entry |= report_unknown(decider, unknown, store, directory, outcomes, fold)
    return entry, outcomes


def calibration_metrics(
    outcomes: Sequence[Outcome], classes: list[str], reject_below: float | None
) -> dict[str, Any]:
    """Entries of ``results.json`` on the probabilities and the samples left without a label."""
    entry: dict[str, Any] = {"calibration": calibration(outcomes, classes)}
    if reject_below is not None:
        entry["selective"] = selective(outcomes, reject_below)
    return entry


def network_facts(classifier: SurfaceClassifier, sample: Sample, store: Store) -> dict[str, Any]:
    """Parameters, and multiply-accumulates for one whole sample.

    The latter is None for a baseline whose arithmetic is outside PyTorch and not counted.
    """
    recordings = load_sample(sample, store)
    return {
        "parameters": classifier.count_parameters(),
        "macs_per_sample": count_macs(lambda: classifier.logits(**recordings)) or None,
    }


def draw_figures(
    outcomes: Sequence[Outcome],
    classes: list[str],
    name: str,
    directory: Path,
    formats: Sequence[str],
) -> dict[str, Any]:
    """Save confusions, accuracy per class and calibration; return the figures for other uses."""
    counts = vote_counts(outcomes, classes)
    title = f"{name}: votes on {len(outcomes)} test samples"
    figures = {
        "confusion": confusion_figure(counts, classes, title),
        "class_accuracy": class_accuracy_figure(counts, classes, name, title),
        "calibration": calibration_figure(outcomes, name),
    }
    for title, figure in figures.items():
        save_figure(figure, directory / "figures" / f"{name}_{title}", formats)
    return figures
