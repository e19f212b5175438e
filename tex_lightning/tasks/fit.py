"""Train a network and test it on the held-out fold; FusionNet trains its two parts first."""

import logging
import time
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.files import read_record
from tex_lightning.report.table import print_results
from tex_lightning.studies.fold import open_and_show, run_fold

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Train and test on ``data.test_fold``; write ``results.json`` and return its content."""
    begin, directory = time.perf_counter(), job.directory
    done = directory / "results.json"
    if done.is_file():
        log.info("This run is finished already.")
        results = read_record(done)
        print_results(results, directory)
        return results
    dataset = open_and_show(config, directory, [config.data])
    results = run_fold(config, dataset, directory, begin=begin, draw=True)
    if results:
        print_results(results, directory)
    return results
