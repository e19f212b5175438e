"""Add classes to a trained network, or remove some, without its training recordings."""

import logging
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained
from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.console import say
from tex_lightning.core.devices import pick_device
from tex_lightning.data.folds import make_samples
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings, plural
from tex_lightning.data.store import Unusable, skipped_entry
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.conditions import counted
from tex_lightning.evaluation.outcomes import environment, write_results
from tex_lightning.learning.enrolment import check_extensible
from tex_lightning.report.table import NEW, OLD, print_results, write_conditions
from tex_lightning.runs.enrolment import (
    enroll,
    forget_classes,
    recordings_to_add,
    write_checkpoint,
)
from tex_lightning.runs.opening import Opening
from tex_lightning.runs.tested import open_store, recordings_to_test
from tex_lightning.runs.testing import draw_figures, report_network
from tex_lightning.runs.usable import find_unusable

DATA = ("data=", "data.root=", "data.manifest=")  # whoever gives one adds classes

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Change the classes of ``checkpoint``; write the new one and ``results.json``.

    Files are decoded as the checkpoint says. With ``data.test_fold`` that fold is left out and all
    its known classes are tested, old and new.
    """
    begin, source = time.perf_counter(), Path(str(config.checkpoint)).expanduser()
    classifier = _load(source)
    forgotten = list(dict.fromkeys(config.enroll.forget or ()))
    if forgotten:
        classifier = forget_classes(classifier, forgotten)
    rows, skipped = Recordings(()), list[Unusable]()
    if not forgotten or any(item.startswith(DATA) for item in job.overrides):
        classifier, rows, skipped = _added(config, classifier)
    seconds = time.perf_counter() - begin
    kind = classifier.card.kind
    target = job.directory / "checkpoints" / f"{kind}.ckpt"
    trained = write_checkpoint(classifier, source, target, seconds)
    counts = Counter((row.label, row.modality) for row in rows)
    entry: dict[str, Any] = {
        "added": {
            label: {each: counts[label, each] for each in classifier.card.modalities}
            for label in rows.classes
        },
        "forgotten": forgotten,
        "enroll_seconds": seconds,
        "checkpoint": str(target.resolve()),
    }
    tested = rows.classes and config.data.test_fold is not None
    if tested:
        entry |= _test(config, trained, job.directory, rows.classes)
    results: dict[str, Any] = {
        "task": config.task,
        "model": kind,
        "data": config.data.name,
        "classes": classifier.card.classes,
        "seed": config.seed,
        "wall_seconds": time.perf_counter() - begin,
        "skipped": skipped_entry(skipped),
        "environment": environment(pick_device(config.trainer.accelerator)),
        "networks": {kind: entry},
    }
    if tested:
        write_conditions(results["networks"], job.directory)
    write_results(job.directory / "results.json", results)
    _say(entry, classifier.card.classes)
    if tested:
        print_results(results, job.directory)
    return results


def _load(source: Path) -> SurfaceClassifier:
    classifier = load_classifier(source)
    if classifier.card.baseline:
        raise UserError(
            f"Checkpoint {source} holds {classifier.card.title}, and task=enroll changes the "
            "classes of this package's networks; train it anew with all recordings."
        )
    return classifier


def _added(
    config: Config, classifier: SurfaceClassifier
) -> tuple[SurfaceClassifier, Recordings, list[Unusable]]:
    """The classifier with the classes of the data, what they were learnt from, and what was not."""
    check_extensible(classifier)
    data, card = config.data, classifier.card
    found = read_recordings(data, card.modalities, least=1)
    needed = found.without(row for row in found if row.modality not in card.modalities)
    rows = recordings_to_add(needed, data, card, config.enroll.only)
    store, senses = open_store(data, classifier), classifier.senses.values()
    skipped = find_unusable(rows, store, senses, skip_bad=data.skip_bad)
    usable = replace(rows, rows=rows.without(each.recording for each in skipped).rows)
    usable = recordings_to_add(usable, replace(data, test_fold=None, per_class=None), card, None)
    Opening(data, str(config.checkpoint), adds=True).announce(usable, store, skipped)
    classifier.to(pick_device(config.trainer.accelerator))
    return enroll(classifier, usable, store), usable, skipped


def _test(
    config: Config, trained: Trained, directory: Path, added: Sequence[str]
) -> dict[str, Any]:
    """Test the new checkpoint on the fold that was left out, as far as it knows its classes.

    Votes on the classes that were ``added`` are counted apart from those on the old ones.
    """
    classifier, data = trained.classifier, config.data
    card = classifier.card
    present = read_recordings(data, card.modalities, least=1).classes
    data = replace(data, hold_out=[name for name in present if name not in card.classes])
    rows = recordings_to_test(data, classifier, "The checkpoint")
    store, senses = open_store(data, classifier), classifier.senses.values()
    skipped = find_unusable(rows, store, senses, skip_bad=data.skip_bad)
    usable = rows.without(each.recording for each in skipped)
    samples = make_samples(usable, card.modalities)
    if not samples:
        raise UserError(
            f"data.test_fold={data.test_fold} holds nothing to test on; choose another, or null "
            "to add all recordings and test nothing."
        )
    classifier.to(pick_device(config.trainer.accelerator))
    entry, outcomes = report_network(trained, samples, store, directory, config)
    draw_figures(outcomes, card.classes, card.kind, directory, config.figures.formats)
    for name, new in ((OLD, False), (NEW, True)):
        own = [outcome for outcome in outcomes if (outcome.label in added) == new]
        if own:
            correct = sum(outcome.label == outcome.predicted for outcome in own)
            entry[name] = counted(correct, len(own))
    return entry


def _say(entry: dict[str, Any], classes: list[str]) -> None:
    for label, counts in entry["added"].items():
        what = " and ".join(f"{count} {plural(name)}" for name, count in counts.items())
        log.info("Added %s from %s.", label, what)
    if entry["forgotten"]:
        log.info("Forgot %s.", listed(entry["forgotten"]))
    seconds = entry["enroll_seconds"]
    say(f"{entry['checkpoint']} knows {len(classes)} classes now ({seconds:.1f} s).")
