"""Add classes to a checkpoint without training it: recordings, network and card."""

import time
from collections import Counter
from dataclasses import replace
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config, Job
from tex_lightning.core.console import say
from tex_lightning.core.devices import pick_device
from tex_lightning.core.run_folder import checkpoint_of, system_name
from tex_lightning.errors import UserError, listed
from tex_lightning.studies.description import show_opening
from tex_lightning.studies.network_results import results_frame
from tex_lightning.studies.new_classes import enroll, open_new_classes


def run(config: Config, job: Job) -> dict[str, Any]:
    """Add the classes of the data to ``checkpoint``; write the new one.

    Files are decoded as the checkpoint says. ``data.test_fold`` is left out, to be tested on.
    """
    begin, source = time.perf_counter(), str(config.checkpoint)
    classifier = load_classifier(source)
    if classifier.card.baseline:
        raise UserError(
            f"Checkpoint {source} holds {classifier.card.title}, and task=enroll adds classes to "
            "this package's networks; train it anew with all recordings."
        )
    dataset = open_new_classes(config.data, classifier)
    what = f"{', '.join(dataset.classes)} for {source}"
    show_opening(config.data, dataset, what, trains=[config.data])
    classifier.to(pick_device(config.trainer.accelerator))
    classifier = enroll(classifier, dataset)
    seconds, card = time.perf_counter() - begin, classifier.card
    target = checkpoint_of(job.directory, card.kind)
    classifier.save(target)
    counts = Counter((row.label, row.modality) for row in dataset.recordings)
    entry = {
        "added": {
            name: {modality: counts[name, modality] for modality in card.modalities}
            for name in dataset.classes
        },
        "enroll_seconds": seconds,
        "checkpoint": str(target.resolve()),
    }
    seconds, networks = time.perf_counter() - begin, {card.kind: entry}
    extended = replace(dataset, classes=card.classes)
    results = results_frame(config, system_name(source), extended, networks, seconds)
    say(f"{target} knows {len(card.classes)} classes. Added: {listed(dataset.classes)}.")
    return results
