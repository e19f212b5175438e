"""Train a network and test it on the held-out fold; FusionNet trains its two parts first."""

import time
from typing import Any

from tex_lightning.config import Config, Job
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.report.table import print_results
from tex_lightning.studies.fold import (
    finished_results,
    open_and_show,
    train_and_test,
    training_results,
)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Train and test on ``data.test_fold``, unless that is done already."""
    begin, directory = time.perf_counter(), job.directory
    results = finished_results(directory, "This run")
    if not results:
        dataset = open_and_show(config, directory, [config.data])
        networks = train_and_test(config, dataset, directory, draw=True)
        if not is_rank_zero():
            return {}
        results = training_results(config, dataset, networks, time.perf_counter() - begin)
    print_results(results, directory)
    return results
