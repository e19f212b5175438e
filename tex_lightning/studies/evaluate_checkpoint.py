"""Test a checkpoint: the recordings it may be tested on, its outcomes, figures and curves."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained
from tex_lightning.config import Config, DataConfig, DecisionConfig
from tex_lightning.data.folds import Sample, split
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root, load_sample
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.calibration import calibration, selective
from tex_lightning.evaluation.conditions import by_condition
from tex_lightning.evaluation.early_stopping import (
    Setting,
    full_labels,
    measure,
    pool,
    read_settings,
    summarise_sequential,
    write_settings,
)
from tex_lightning.evaluation.novelty import report_unknown
from tex_lightning.evaluation.outcomes import Outcome, summarise, vote_counts, write_outcomes
from tex_lightning.evaluation.samples import run_test
from tex_lightning.inference.early_stopping import (
    SEQUENTIAL,
    SequentialClassifier,
    make_inference_model,
    needs_threshold,
)
from tex_lightning.inference.engine import count_macs
from tex_lightning.inference.prediction import warn_of_few
from tex_lightning.report.confusion import class_accuracy_figure, confusion_figure
from tex_lightning.report.figures import calibration_figure, save_figure, sequential_figure
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


ALPHA, THRESHOLD = "alpha", "confidence_threshold"
FILE = "sequential.csv"


def report_sequential(
    classifier: SequentialClassifier,
    config: DecisionConfig,
    samples: Sequence[Sample],
    store: Store,
    directory: Path,
) -> dict[str, Any]:
    """Classify with every threshold; write ``sequential.csv`` and its figure.

    Returns:
        The thresholds used, mean cost, accuracy and agreement for ``results.json``.
    """
    labels = full_labels(classifier.full, samples, store)
    used = replace(config, calibrated=False, confidence_threshold=classifier.threshold)
    settings = [
        measure(classifier.full, decision, samples, labels, store, knob, value)
        for knob, value, decision in _decisions(used, _knobs(classifier))
    ]
    write_settings(settings, directory / FILE)
    draw_sequential(settings, classifier.card.kind, directory)
    return {**_thresholds(used), **summarise_sequential(settings[0])}


def pool_sequential(
    folds: Sequence[Path],
    name: str,
    directory: Path,
    config: DecisionConfig,
) -> dict[str, Any]:
    """Pool several folds, from their files; nothing where decisions were not sequential."""
    settings = pool(
        item for fold in folds for item in read_settings(fold / FILE) if item.network == name
    )
    if config.name != SEQUENTIAL or not settings:
        return {}
    write_settings(settings, directory / FILE)
    draw_sequential(settings, name, directory)
    return {"sequential": {**_thresholds(config), **summarise_sequential(settings[0])}}


def _knobs(classifier: SequentialClassifier) -> tuple[str, ...]:
    """The thresholds that matter: of photos alpha, of a single signal the probability."""
    windowed = any(sense.windowed for sense in classifier.full.senses.values())
    by_probability = (THRESHOLD,) if needs_threshold(classifier.full) else ()
    return (*((ALPHA,) if windowed else ()), *by_probability)


def _thresholds(used: DecisionConfig) -> dict[str, float]:
    return {ALPHA: used.alpha, THRESHOLD: used.confidence_threshold}


def _decisions(
    used: DecisionConfig, knobs: Sequence[str]
) -> Iterator[tuple[str, float, DecisionConfig]]:
    yield "used", used.alpha, used
    for knob in knobs:
        for value in getattr(used, f"{knob}s"):
            changed = {knob: value}
            if knob == "alpha" and "confidence_threshold" in knobs:
                changed["confidence_threshold"] = 1.0  # the windows are asked of every sample
            yield knob, value, replace(used, **changed)


def draw_sequential(settings: Sequence[Setting], name: str, directory: Path) -> None:
    """Save the figure of a network's curves."""
    figure = sequential_figure(settings, name)
    save_figure(figure, directory / "figures" / f"{name}_sequential")


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
        entry["sequential"] = report_sequential(decider, config.decision, samples, store, directory)
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
