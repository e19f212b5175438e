"""Test a checkpoint on a fold of any data set, or on the whole of it."""

import time
from dataclasses import replace
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config, Job
from tex_lightning.core.devices import pick_device
from tex_lightning.core.run_folder import system_name
from tex_lightning.data.folds import tested_part
from tex_lightning.inference.prediction import check_unknown
from tex_lightning.learning.loggers import open_loggers
from tex_lightning.report.table import print_results
from tex_lightning.studies.dataset import open_test_data
from tex_lightning.studies.description import show_opening
from tex_lightning.studies.network_results import log_network, report_network, results_frame
from tex_lightning_runtime.files import expanded


def run(config: Config, job: Job) -> dict[str, Any]:
    """Classify the test samples with ``checkpoint``.

    Files are decoded as the checkpoint says, whatever the configuration has; only
    ``data.file_rate`` belongs to the files themselves and is taken from it if it is given.
    """
    begin, directory = time.perf_counter(), job.directory
    checkpoint = expanded(str(config.checkpoint))
    classifier = load_classifier(checkpoint)
    classifier.to(pick_device(config.trainer.accelerator))
    card = classifier.card
    check_unknown(card.deciding(config.decision), bool(classifier.statistics))
    choose = config.data.test_fold is None and not job.sets("data.test_fold")
    dataset, data = open_test_data(config.data, classifier, "The checkpoint", choose=choose)
    config = replace(config, data=data)
    known = "which its training left out" if data.withholds else "which its training has not seen"
    part = f"{tested_part(data)}, {known if choose else 'as asked for'}"
    show_opening(data, dataset, f"{part}, by {config.checkpoint}", keep_in=directory)
    network, further = report_network(config, dataset, classifier, checkpoint, directory, draw=True)
    loggers, networks = open_loggers(config.logger, directory, card.kind), {card.kind: network}
    log_network(config, dataset.classes, directory, loggers, networks, further, trained=False)
    seconds, baseline = time.perf_counter() - begin, bool(card.baseline)
    model = str(card.baseline.get("name", system_name(checkpoint)))
    results = results_frame(config, model, dataset, networks, seconds, baseline=baseline)
    print_results(results, directory)
    return results
