"""Time, arithmetic and memory of each unimodal network, beside its sliding-window form."""

from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.studies.profile import profile_networks


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure ``model`` or ``checkpoint``; write ``results.json`` and figures, and return it."""
    return profile_networks(config, job)
