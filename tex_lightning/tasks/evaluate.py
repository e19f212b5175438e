"""Test a checkpoint on a fold of any data set, or on the whole of it."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.folds import NEEDS, make_samples, split
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root
from tex_lightning.data.unusable import skipped_entry
from tex_lightning.devices import pick_device
from tex_lightning.errors import UserError, listed
from tex_lightning.report.opening import announce
from tex_lightning.report.results import environment, write_results
from tex_lightning.report.table import print_results
from tex_lightning.schema import Config, DataConfig
from tex_lightning.tasks.seen import refuse_leak
from tex_lightning.tasks.testing import draw_figures, report_network
from tex_lightning.tasks.usable import find_unusable
from tex_lightning.tasks.workspace import hold_out


def run(config: Config, directory: Path) -> dict[str, Any]:
    """Classify the test samples with ``checkpoint``; write ``results.json`` and return it.

    Files are decoded as the checkpoint says, whatever the configuration has; only
    ``data.file_rate`` belongs to the files themselves and is taken from it if it is given.
    """
    begin = time.perf_counter()
    checkpoint = Path(cast(str, config.checkpoint)).expanduser()
    classifier = load_classifier(checkpoint)
    device = pick_device(config.trainer.accelerator)
    classifier.to(device)
    kind, classes = classifier.card.kind, classifier.card.classes
    test = recordings_to_test(config.data, classifier, "The checkpoint")
    unknown = _held_out(config.data, classifier)
    settings = classifier.card.settings_for(config.data.file_rate)
    store = Store(cache_root(config.data.cache_dir), settings)
    both = replace(test, rows=test.rows + unknown.rows)
    features, least_side = classifier.haptic_features, classifier.least_side
    skipped = find_unusable(both, store, features, least_side, skip_bad=config.data.skip_bad)
    bad = [each.recording for each in skipped]
    announce(config, both.without(bad), store, skipped)
    samples = make_samples(test.without(bad), kind)
    unknown_samples = make_samples(unknown.without(bad), kind)
    if not samples:
        raise UserError(
            f"There is nothing to test a {kind} network on; choose another data.test_fold, or "
            "data.test_fold=null for everything."
        )
    network, outcomes = report_network(
        classifier, checkpoint, samples, store, directory, config, unknown_samples
    )
    draw_figures(outcomes, classes, kind, directory)
    results = {
        "task": config.task,
        "model": kind,
        "data": config.data.name,
        "classes": classes,
        "seed": config.seed,
        "wall_seconds": time.perf_counter() - begin,
        "skipped": skipped_entry(skipped),
        "environment": environment(device),
        "networks": {kind: network},
    }
    write_results(directory / "results.json", results)
    print_results(results, directory)
    return results


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
    rows, _ = hold_out(read_recordings(data), data.hold_out)
    unknown = [label for label in rows.classes if label not in card.classes]
    if unknown:
        raise UserError(
            f"{who} does not know the class {listed(unknown)}; leave it out of the "
            "data, name it in data.hold_out or train on it."
        )
    return _tested(rows, data, card, who)


def _held_out(data: DataConfig, classifier: SurfaceClassifier) -> Recordings:
    """The recordings of the classes in ``data.hold_out`` in the test fold.

    Raises:
        UserError: If there is no such class, or the checkpoint was trained on it.
    """
    _, held = hold_out(read_recordings(data), data.hold_out)
    return _tested(held, data, classifier.card, "The checkpoint")


def _tested(rows: Recordings, data: DataConfig, card: Card, who: str) -> Recordings:
    wanted = rows.without(row for row in rows if row.modality not in NEEDS[card.kind])
    test = split(wanted, data.folds, data.test_fold, data.val_fold, data.inverted).test
    refuse_leak(test, card, who)
    return replace(test, notes=rows.notes)
