"""Add classes to a trained network, or remove some, without its training recordings."""

from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.studies.enrolment import change_classes


def run(config: Config, job: Job) -> dict[str, Any]:
    """Change the classes of ``checkpoint``; write the new one and ``results.json``."""
    return change_classes(config, job)
