"""Add classes to a checkpoint without training it."""

import time
from collections import Counter
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.console import say
from tex_lightning.core.devices import pick_device
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.outcomes import write_results
from tex_lightning.studies.dataset import show_opening
from tex_lightning.studies.enrolment import enroll, open_new_classes
from tex_lightning.studies.evaluate_checkpoint import results_frame


def run(config: Config, job: Job) -> dict[str, Any]:
    """Add the classes of the data to ``checkpoint``; write the new one and ``results.json``.

    Files are decoded as the checkpoint says. ``data.test_fold`` is left out, to be tested on.
    """
    begin, source = time.perf_counter(), Path(str(config.checkpoint)).expanduser()
    classifier = load_classifier(source)
    if classifier.card.baseline:
        raise UserError(
            f"Checkpoint {source} holds {classifier.card.title}, and task=enroll adds classes to "
            "this package's networks; train it anew with all recordings."
        )
    dataset = open_new_classes(config.data, classifier)
    show_opening(config.data, dataset, f"{', '.join(dataset.classes)} for {source}")
    classifier.to(pick_device(config.trainer.accelerator))
    classifier = enroll(classifier, dataset)
    seconds, card = time.perf_counter() - begin, classifier.card
    target = job.directory / "checkpoints" / f"{card.kind}.ckpt"
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
    results = results_frame(config, card.kind, card.classes, dataset.skipped, networks, seconds)
    write_results(job.directory / "results.json", results)
    say(f"{target} knows {len(card.classes)} classes. Added: {listed(dataset.classes)}.")
    return results
