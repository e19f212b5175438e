"""Find where systems fail: perturb their test recordings at increasing severity and vote."""

from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.studies.stability import perturb_systems


def run(config: Config, job: Job) -> dict[str, Any]:
    """Test ``stability.systems`` under all perturbations that they meet; return the results."""
    return perturb_systems(config, job)
