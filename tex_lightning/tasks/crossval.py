"""Test every fold once with networks trained on all the others, and pool the counts."""

from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.studies.crossval import cross_validate


def run(config: Config, job: Job) -> dict[str, Any]:
    """Run all folds, or those in ``crossval.only``; write ``results.json`` and return it."""
    return cross_validate(config, job)
