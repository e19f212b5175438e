"""Test a checkpoint on a fold of any data set, or on the whole of it."""

import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_trained
from tex_lightning.config import Config, plain_values
from tex_lightning.config.composition import Job
from tex_lightning.core.devices import pick_device
from tex_lightning.data.folds import make_samples, tested_part
from tex_lightning.data.store import skipped_entry
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import environment, write_results
from tex_lightning.inference.prediction import check_unknown
from tex_lightning.learning.loggers import log_test
from tex_lightning.report.table import print_results, write_conditions
from tex_lightning.studies.console_summary import Opening
from tex_lightning.studies.dataset import find_unusable
from tex_lightning.studies.evaluate_checkpoint import (
    draw_figures,
    held_out_to_test,
    open_store,
    recordings_to_test,
    report_network,
)
from tex_lightning.studies.sample_maps import draw_telling


def run(config: Config, job: Job) -> dict[str, Any]:
    """Classify the test samples with ``checkpoint``; write ``results.json`` and return it.

    Files are decoded as the checkpoint says, whatever the configuration has; only
    ``data.file_rate`` belongs to the files themselves and is taken from it if it is given.
    """
    begin, directory = time.perf_counter(), job.directory
    checkpoint = Path(str(config.checkpoint)).expanduser()
    trained = load_trained(checkpoint)
    classifier = trained.classifier
    device = pick_device(config.trainer.accelerator)
    classifier.to(device)
    kind, classes = classifier.card.kind, classifier.card.classes
    check_unknown(classifier.card.deciding(config.decision), bool(classifier.statistics))
    test = recordings_to_test(config.data, classifier, "The checkpoint")
    unknown = held_out_to_test(config.data, classifier)
    store = open_store(config.data, classifier)
    both = replace(test, rows=test.rows + unknown.rows)
    senses = classifier.senses.values()
    skipped = find_unusable(both, store, senses, skip_bad=config.data.skip_bad)
    bad = [each.recording for each in skipped]
    Opening(config.data, str(config.checkpoint)).announce(both.without(bad), store, skipped)
    modalities = classifier.card.modalities
    samples = make_samples(test.without(bad), modalities)
    unknown_samples = make_samples(unknown.without(bad), modalities)
    if not samples:
        raise UserError(
            f"There is nothing to test a {kind} network on in {tested_part(config.data)}; choose "
            "another data.test_fold or data.test_where, or data.test_fold=null for everything."
        )
    network, outcomes = report_network(trained, samples, store, directory, config, unknown_samples)
    figures = draw_figures(outcomes, classes, kind, directory)
    figures |= draw_telling(classifier, samples, outcomes, store, config, directory)
    values = plain_values(config)
    tested_on = {name: values[name] for name in ("seed", "data")}
    log_test(config.logger, directory, kind, tested_on, network, figures)
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
    write_conditions({kind: network}, directory)
    write_results(directory / "results.json", results)
    print_results(results, directory)
    return results
