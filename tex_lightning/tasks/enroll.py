"""Add classes to a checkpoint, or remove some, without training it."""

import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import Trained
from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.console import say
from tex_lightning.core.devices import pick_device
from tex_lightning.data.folds import make_samples
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.outcomes import write_results
from tex_lightning.report.table import print_results, write_conditions
from tex_lightning.studies.dataset import Dataset, open_test_data, show_opening
from tex_lightning.studies.enrolment import (
    enroll,
    forget_classes,
    open_new_classes,
    write_checkpoint,
)
from tex_lightning.studies.evaluate_checkpoint import draw_figures, report_network, results_frame

DATA = ("data", "data.root", "data.manifest")  # whoever gives one of these keys adds classes


def run(config: Config, job: Job) -> dict[str, Any]:
    """Change the classes of ``checkpoint``; write the new one and ``results.json``.

    Files are decoded as the checkpoint says. With ``data.test_fold`` that fold is left out and all
    its known classes are tested, old and new.
    """
    begin, source = time.perf_counter(), Path(str(config.checkpoint)).expanduser()
    classifier = load_classifier(source)
    if classifier.card.baseline:
        raise UserError(
            f"Checkpoint {source} holds {classifier.card.title}, and task=enroll changes the "
            "classes of this package's networks; train it anew with all recordings."
        )
    forgotten = list(dict.fromkeys(config.enroll.forget or ()))
    if forgotten:
        classifier = forget_classes(classifier, forgotten)
    dataset: Dataset | None = None
    if not forgotten or any(item.partition("=")[0] in DATA for item in job.overrides):
        dataset = open_new_classes(config, classifier)
        show_opening(config, dataset, f"{', '.join(dataset.classes)} for {source}")
        classifier.to(pick_device(config.trainer.accelerator))
        classifier = enroll(classifier, dataset.recordings, dataset.store)
    seconds, card = time.perf_counter() - begin, classifier.card
    target = job.directory / "checkpoints" / f"{card.kind}.ckpt"
    trained = write_checkpoint(classifier, source, target, seconds)
    rows = Recordings(()) if dataset is None else dataset.recordings
    counts = Counter((row.label, row.modality) for row in rows)
    entry: dict[str, Any] = {
        "added": {
            name: {modality: counts[name, modality] for modality in card.modalities}
            for name in rows.classes
        },
        "forgotten": forgotten,
        "enroll_seconds": seconds,
        "checkpoint": str(target.resolve()),
    }
    tested = dataset is not None and config.data.test_fold is not None
    if tested:
        entry |= _test(config, trained, job.directory)
    skipped, networks = () if dataset is None else dataset.skipped, {card.kind: entry}
    seconds = time.perf_counter() - begin
    results = results_frame(config, card.kind, card.classes, skipped, networks, seconds)
    write_results(job.directory / "results.json", results)
    added, removed = listed(rows.classes) or "none", listed(forgotten) or "none"
    say(f"{target} knows {len(card.classes)} classes. Added: {added}. Removed: {removed}.")
    if tested:
        write_conditions(networks, job.directory)
        print_results(results, job.directory)
    return results


def _test(config: Config, trained: Trained, directory: Path) -> dict[str, Any]:
    """Test the new checkpoint on the fold that was left out, as far as it knows its classes."""
    classifier, card = trained.classifier, trained.classifier.card
    present = read_recordings(config.data, card.modalities, least=1).classes
    unknown = [name for name in present if name not in card.classes]
    known = replace(config, data=replace(config.data, hold_out=unknown))
    dataset = open_test_data(known, classifier, "The checkpoint")
    samples = make_samples(dataset.recordings, card.modalities)
    classifier.to(pick_device(config.trainer.accelerator))
    entry, outcomes = report_network(trained, samples, dataset.store, directory, config)
    draw_figures(outcomes, card.classes, card.kind, directory)
    return entry
