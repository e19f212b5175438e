"""Test sequential decisions against the full one, over their thresholds."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.config import DecisionConfig
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store
from tex_lightning.evaluation.early_stopping import (
    Setting,
    full_labels,
    measure,
    pool,
    read_settings,
    summarise_sequential,
    write_settings,
)
from tex_lightning.inference.early_stopping import SEQUENTIAL, SequentialClassifier, needs_threshold
from tex_lightning.report.figures import save_figure, sequential_figure

ALPHA, THRESHOLD = "alpha", "confidence_threshold"
FILE = "sequential.csv"


def report_sequential(
    classifier: SequentialClassifier,
    config: DecisionConfig,
    samples: Sequence[Sample],
    store: Store,
    directory: Path,
    formats: Sequence[str],
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
    draw_sequential(settings, classifier.card.kind, directory, formats)
    return {**_thresholds(used), **summarise_sequential(settings[0])}


def pool_sequential(
    folds: Sequence[Path],
    name: str,
    directory: Path,
    config: DecisionConfig,
    formats: Sequence[str],
) -> dict[str, Any]:
    """Pool several folds, from their files; nothing where decisions were not sequential."""
    settings = pool(
        item for fold in folds for item in read_settings(fold / FILE) if item.network == name
    )
    if config.name != SEQUENTIAL or not settings:
        return {}
    write_settings(settings, directory / FILE)
    draw_sequential(settings, name, directory, formats)
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


def draw_sequential(
    settings: Sequence[Setting], name: str, directory: Path, formats: Sequence[str]
) -> None:
    """Save the figure of a network's curves."""
    figure = sequential_figure(settings, name)
    save_figure(figure, directory / "figures" / f"{name}_sequential", formats)
