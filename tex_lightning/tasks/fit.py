"""Train a network and test it on the held-out fold; FusionNet trains its two parts first."""

import logging
import time
from pathlib import Path
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.files import read_record
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.evaluation.outcomes import write_results
from tex_lightning.report.table import print_results, write_conditions
from tex_lightning.studies.console_summary import Opening, trained_networks
from tex_lightning.studies.dataset import open_workspace
from tex_lightning.studies.fold import fit_fold, results_frame

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Train and test on ``data.test_fold``; write ``results.json`` and return its content."""
    begin, directory = time.perf_counter(), job.directory
    if (done := _finished(directory)) is not None:
        return done
    opening = Opening(config.data, trained_networks(config.model), [config.data.test_fold])
    workspace = open_workspace(config, directory, opening)
    networks = fit_fold(workspace, draw=True)
    if not is_rank_zero():
        return {}
    results = results_frame(config.task, workspace, networks, time.perf_counter() - begin)
    write_conditions(results["networks"], directory)
    write_results(directory / "results.json", results)
    print_results(results, directory)
    return results


def _finished(directory: Path) -> dict[str, Any] | None:
    """The results of a run that is finished already, shown again; None if it is not."""
    done = directory / "results.json"
    if not done.is_file():
        return None
    log.info("This run is finished already.")
    results = read_record(done)
    print_results(results, directory)
    return results
