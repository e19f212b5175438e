"""Train a network and test it on the held-out fold; FusionNet trains its two parts first."""

import time
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.report.table import print_results
from tex_lightning.studies.fold import finished_results, open_and_show, run_fold


def run(config: Config, job: Job) -> dict[str, Any]:
    """Train and test on ``data.test_fold``; write ``results.json`` and return its content."""
    begin, directory = time.perf_counter(), job.directory
    results = finished_results(directory, "This run")
    if results is None:
        dataset = open_and_show(config, directory, [config.data])
        results = run_fold(config, dataset, directory, begin=begin, draw=True)
    if results:
        print_results(results, directory)
    return results
