"""Test a checkpoint: the recordings it may be tested on, its outcomes, figures and curves."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from typing import Any

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained
from tex_lightning.config import Config, DataConfig
from tex_lightning.data.folds import Sample, split
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root, load_sample
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.calibration import calibration, selective
from tex_lightning.evaluation.conditions import by_condition
from tex_lightning.evaluation.novelty import report_unknown
from tex_lightning.evaluation.outcomes import Outcome, summarise, vote_counts, write_outcomes
from tex_lightning.evaluation.samples import run_test
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.inference.engine import count_macs
from tex_lightning.inference.prediction import warn_of_few
from tex_lightning.report.confusion import class_accuracy_figure, confusion_figure
from tex_lightning.report.figures import calibration_figure, save_figure
from tex_lightning.studies.dataset import hold_out
from tex_lightning.studies.leaks import refuse_leak


def recordings_to_test(data: DataConfig, classifier: SurfaceClassifier, who: str) -> Recordings:
    """The recordings to test on, without the classes in ``data.hold_out``.

    Args:
        data: Where they come from and which fold.
        classifier: What is tested.
        who: Its name in messages.

    Raises:
        UserError: If their classes are unknown to the checkpoint, or it was trained on them.
    """
    card = classifier.card
    rows, _ = hold_out(read_recordings(data, card.modalities), data.hold_out)
    unknown = [label for label in rows.classes if label not in card.classes]
    if unknown:
        raise UserError(
            f"{who} does not know the class {listed(unknown)}; leave it out of the "
            "data, name it in data.hold_out or train on it."
        )
    return _tested(rows, data, card, who)


def open_store(data: DataConfig, classifier: SurfaceClassifier) -> Store:
    """Open a store that decodes recordings with a checkpoint's settings.

    Only ``data.file_rate`` belongs to the files themselves and counts if it is given.
    """
    decoders = {
        sense.modality: sense.decoder.assuming(data.file_rate)
        for sense in classifier.senses.values()
    }
    return Store(cache_root(data.cache_dir), decoders)


def held_out_to_test(data: DataConfig, classifier: SurfaceClassifier) -> Recordings:
    """The recordings of the classes in ``data.hold_out`` in the test fold.

    Raises:
        UserError: If there is no such class, or the checkpoint was trained on it.
    """
    card = classifier.card
    _, held = hold_out(read_recordings(data, card.modalities), data.hold_out)
    return _tested(held, data, card, "The checkpoint")


def _tested(rows: Recordings, data: DataConfig, card: Card, who: str) -> Recordings:
    wanted = rows.without(row for row in rows if row.modality not in card.modalities)
    test = split(wanted, data).test
    refuse_leak(test, card, who, data)
    return replace(test, notes=rows.notes)


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
    kind = classifier.card.kind
    warn_of_few(classifier.card.deciding(config.decision))
    decider = make_inference_model(classifier, config.engine, config.decision)
    fold = None if config.data.test_where else config.data.test_fold
    outcomes = run_test(decider, samples, store, fold)
    write_outcomes(outcomes, directory / "predictions" / f"{kind}.csv")
    entry = {
        **summarise(outcomes),
        **by_condition(samples, outcomes),
        **calibration_metrics(outcomes, decider.card.reject_below),
        **network_facts(classifier, samples[0], store),
        "fit_seconds": trained.fit_seconds,
        "val_loss": trained.val_loss,  # None where nothing was validated
        "checkpoint": str(trained.checkpoint.resolve()),
    }
    entry |= report_unknown(decider, unknown, store, directory, outcomes, fold)
    return entry, outcomes


def calibration_metrics(outcomes: Sequence[Outcome], reject_below: float | None) -> dict[str, Any]:
    """Entries of ``results.json`` on the probabilities and the samples left without a label."""
    entry: dict[str, Any] = {"calibration": calibration(outcomes)}
    if reject_below is not None:
        entry["selective"] = selective(outcomes, reject_below)
    if any(outcome.relative_macs != 1 for outcome in outcomes):  # of sequential decisions
        entry["relative_macs"] = fmean(outcome.relative_macs for outcome in outcomes)
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
        save_figure(figure, directory / "figures" / f"{name}_{title}")
    return figures
