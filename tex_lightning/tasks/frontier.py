"""Measure a family of systems on the same folds: accuracy against latency, and a choice."""

from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.studies.frontier import compare_family


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure the family; write table, charts and ``results.json``, and return the latter."""
    return compare_family(config, job)
