"""Change the classes of a checkpoint: checks, recordings, card, file."""

import logging
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import Card, read_checkpoint
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained, lightning_state
from tex_lightning.config import Config, DataConfig
from tex_lightning.config.composition import Job
from tex_lightning.config.keys import nearest
from tex_lightning.core.console import say
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import write_atomically
from tex_lightning.data.folds import make_samples, next_of_each, split
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings, plural
from tex_lightning.data.store import Store
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.conditions import counted
from tex_lightning.evaluation.outcomes import write_results
from tex_lightning.learning.enrolment import Fragments, add_classes, check_extensible, keep_classes
from tex_lightning.learning.statistics import position_features
from tex_lightning.report.table import NEW, OLD, print_results, write_conditions
from tex_lightning.studies.dataset import (
    Dataset,
    find_unusable,
    open_store,
    open_test_data,
    show_opening,
)
from tex_lightning.studies.evaluate_checkpoint import draw_figures, report_network, results_frame
from tex_lightning.studies.leaks import digests

log = logging.getLogger(__name__)
DATA = ("data", "data.root", "data.manifest")  # whoever gives one of these keys adds classes
VALIDATED = ("confidence_threshold", "disagreement")  # of a calibration, for the old classes alone


def forget_classes(classifier: SurfaceClassifier, names: Sequence[str]) -> SurfaceClassifier:
    """Copy a classifier without some classes; its record of their recordings stays.

    Raises:
        UserError: If it does not know one of them, or fewer than two would be left.
    """
    known = classifier.card.classes
    for name in names:
        if name not in known:
            raise UserError(
                f"enroll.forget names {name}{nearest(name, known)}, which the checkpoint does not "
                f"know; choose from {listed(known)}."
            )
    kept = [name for name in known if name not in names]
    if len(kept) < 2:
        raise UserError(
            f"Without {listed(names)} the checkpoint would know {len(kept)} of its {len(known)} "
            "classes, and telling classes apart takes two; forget fewer, or train a new network."
        )
    found = keep_classes(classifier, kept)
    found.card = replace(found.card, calibration=_still_valid(found.card))
    return found


def recordings_to_add(
    recordings: Recordings, data: DataConfig, card: Card, only: Sequence[str] | None
) -> Recordings:
    """The recordings of new classes, without a test fold if there is one.

    Args:
        recordings: All that were read, of modalities that the network looks at.
        data: Says what is tested, and how many of a class are used.
        card: Card of the network.
        only: Classes that are added; None adds all.

    Raises:
        UserError: If a class is known already, absent or lacks a sense.
    """
    classes = recordings.classes
    for name in only or ():
        if name not in classes:
            raise UserError(
                f"enroll.only names {name}{nearest(name, classes)}, and the data has no such "
                f"class; choose from {listed(classes)}."
            )
    added = [name for name in classes if only is None or name in only]
    if known := [name for name in added if name in card.classes]:
        raise UserError(
            f"The checkpoint knows {listed(known)} already; name the new classes in enroll.only, "
            f"or replace it by enroll.forget=[{','.join(known)}] in the same command."
        )
    rows = recordings.in_classes(added)
    if not added:
        raise UserError(
            f"The data has no {' or '.join(map(plural, card.modalities))} to learn a class from, "
            f"which is what this {card.kind} network looks at; record some."
        )
    if data.test_fold is not None:
        rows = split(rows, data).train
    elif data.per_class is not None:
        chosen = next_of_each(rows.rows, data.per_class, 0, data.folds)
        rows = replace(rows, rows=tuple(chosen))
    for modality in card.modalities:
        if absent := sorted(set(added) - {row.label for row in rows.of(modality)}):
            raise UserError(
                f"There are no {plural(modality)} of {listed(absent)} to learn from, and this "
                f"{card.kind} network looks at {' and '.join(card.modalities)}; record them, or "
                "add the class to a network that does without."
            )
    return rows


def enroll(classifier: SurfaceClassifier, rows: Recordings, store: Store) -> SurfaceClassifier:
    """Copy a classifier to the CPU, and add the classes of the recordings to it and its card.

    Args:
        classifier: On the device that computes the features; it ends on the CPU.
        rows: Rows of the new classes.
        store: Where they are decoded.

    Raises:
        UserError: If classes cannot be added to this network.
    """
    names = rows.classes
    features: dict[str, Fragments] = {}
    for name, sense in classifier.senses.items():
        own = rows.of(sense.modality).rows
        found = position_features(classifier, name, own, store)
        labelled = list(zip((row.label for row in own), found, strict=True))
        features[name] = [[each for label, each in labelled if label == one] for one in names]
    extended = add_classes(classifier.cpu(), names, features)
    card = extended.card
    seen = card.trained_on.get("seen", [])
    fresh = [digest for digest in digests(rows) if digest not in seen]
    extended.card = replace(
        card,
        calibration=_still_valid(card),
        input_ranges=_wider_ranges(card, rows, store),
        trained_on={**card.trained_on, "seen": [*seen, *fresh]},
    )
    return extended


def write_checkpoint(
    classifier: SurfaceClassifier, source: Path, target: Path, seconds: float
) -> Trained:
    """Write a changed classifier as the training wrote its source.

    Args:
        classifier: On the CPU.
        source: Checkpoint that it came from.
        target: The new file.
        seconds: Seconds that the change took, which are added to those of the training.
    """
    content = read_checkpoint(source)
    content["hyper_parameters"]["card"] = classifier.card.to_dict()
    content["state_dict"] = lightning_state(classifier)
    content["fit_seconds"] = content.get("fit_seconds", 0.0) + seconds
    content["val_loss"] = None
    write_atomically(target, lambda partial: torch.save(content, partial))
    return Trained(classifier, target, content["fit_seconds"])


def _still_valid(card: Card) -> dict[str, float]:
    """The calibration without what was shown for the old classes alone."""
    return {name: value for name, value in card.calibration.items() if name not in VALIDATED}


def _wider_ranges(card: Card, rows: Recordings, store: Store) -> dict[str, dict[str, list[float]]]:
    """By modality the ends of each measure, over the old and the new recordings."""
    found = {}
    for modality, old in card.input_ranges.items():
        new = training_ranges(rows.of(modality), store)
        found[modality] = {
            name: [min(low, new[name][0]), max(high, new[name][1])]
            for name, (low, high) in old.items()
        }
    return found


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
    dataset = None
    if not forgotten or any(item.partition("=")[0] in DATA for item in job.overrides):
        dataset = _data_to_add(config, classifier)
        classifier.to(pick_device(config.trainer.accelerator))
        classifier = enroll(classifier, dataset.recordings, dataset.store)
    rows = Recordings(()) if dataset is None else dataset.recordings
    seconds, card = time.perf_counter() - begin, classifier.card
    target = job.directory / "checkpoints" / f"{card.kind}.ckpt"
    trained = write_checkpoint(classifier, source, target, seconds)
    counts = Counter((row.label, row.modality) for row in rows)
    entry: dict[str, Any] = {
        "added": {name: {each: counts[name, each] for each in card.modalities}
                  for name in rows.classes},
        "forgotten": forgotten,
        "enroll_seconds": seconds,
        "checkpoint": str(target.resolve()),
    }  # fmt: skip
    tested = rows.classes and config.data.test_fold is not None
    if tested:
        entry |= _test(config, trained, job.directory, rows.classes)
    skipped = () if dataset is None else dataset.skipped
    networks, seconds = {card.kind: entry}, time.perf_counter() - begin
    results = results_frame(config, card.kind, card.classes, skipped, networks, seconds)
    if tested:
        write_conditions(networks, job.directory)
    write_results(job.directory / "results.json", results)
    log.info(
        "Added: %s. Forgotten: %s.", listed(rows.classes) or "none", listed(forgotten) or "none"
    )
    say(f"{target} knows {len(card.classes)} classes now ({entry['enroll_seconds']:.1f} s).")
    if tested:
        print_results(results, job.directory)
    return results


def _data_to_add(config: Config, classifier: SurfaceClassifier) -> Dataset:
    """The recordings of the new classes, as far as they can be used."""
    check_extensible(classifier)
    data, card = config.data, classifier.card
    found = read_recordings(data, card.modalities, least=1)
    needed = found.without(row for row in found if row.modality not in card.modalities)
    rows = recordings_to_add(needed, data, card, config.enroll.only)
    store, senses = open_store(config, classifier), classifier.senses.values()
    skipped = find_unusable(rows, store, senses, store.fill(rows), skip_bad=data.skip_bad)
    usable = replace(rows, rows=rows.without(each.recording for each in skipped).rows)
    usable = recordings_to_add(usable, replace(data, test_fold=None, per_class=None), card, None)
    dataset = Dataset(config, usable.classes, usable, Recordings(()), store, tuple(skipped))
    show_opening(config, dataset, f"{', '.join(usable.classes)} for {config.checkpoint}")
    return dataset


def _test(
    config: Config, trained: Trained, directory: Path, added: Sequence[str]
) -> dict[str, Any]:
    """Test the new checkpoint on the fold that was left out, as far as it knows its classes.

    Votes on the classes that were ``added`` are counted apart from those on the old ones.
    """
    classifier, card = trained.classifier, trained.classifier.card
    present = read_recordings(config.data, card.modalities, least=1).classes
    strange = [name for name in present if name not in card.classes]
    known = replace(config, data=replace(config.data, hold_out=strange))
    dataset = open_test_data(known, classifier, "The checkpoint")
    samples = make_samples(dataset.recordings, card.modalities)
    classifier.to(pick_device(config.trainer.accelerator))
    entry, outcomes = report_network(trained, samples, dataset.store, directory, config)
    draw_figures(outcomes, card.classes, card.kind, directory)
    for name, new in ((OLD, False), (NEW, True)):
        own = [outcome for outcome in outcomes if (outcome.label in added) == new]
        if own:
            correct = sum(outcome.label == outcome.predicted for outcome in own)
            entry[name] = counted(correct, len(own))
    return entry
