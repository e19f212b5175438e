"""Train a network and test it on the held-out fold; FusionNet trains its two parts first."""

import logging
import time
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.files import read_record
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.evaluation.outcomes import write_results
from tex_lightning.report.table import print_results
from tex_lightning.studies.fold import fit_fold, open_announced, training_results

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
    dataset = open_announced(config, directory, [config.data])
    networks = fit_fold(config, dataset, directory, draw=True)
    if not is_rank_zero():
        return {}
    results = training_results(config, dataset, networks, time.perf_counter() - begin)
    write_results(done, results)
    print_results(results, directory)
    return results
