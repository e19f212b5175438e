"""Write a trained network to a file that runs without this package."""

from typing import Any

from tex_lightning.config import Config, Job
from tex_lightning.export.files import export_checkpoint
from tex_lightning_runtime.files import expanded


def run(config: Config, job: Job) -> dict[str, Any]:
    """Write ``checkpoint`` to ``export.out`` as ``export.format``, and what was measured."""
    checkpoint = expanded(str(config.checkpoint))
    out = job.directory if config.export.out is None else expanded(config.export.out)
    return export_checkpoint(config, checkpoint, out)
