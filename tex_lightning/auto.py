"""``model=auto``: the configuration of the system that task=frontier found to be enough."""

import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.config.weights import read_config
from tex_lightning.core.files import read_record
from tex_lightning.errors import UserError
from tex_lightning.runs.family import with_system
from tex_lightning.tasks import frontier

log = logging.getLogger(__name__)


def resolve_auto(finished: str | None, test_fold: int | None, job: Job) -> Config:
    """The configuration of a job whose ``model=auto`` is the chosen system of a family.

    Args:
        finished: The run folder of the family (``frontier.run``). Without it the family is measured
            here, and chosen on the partner of the tested fold, by networks that have seen neither.
        test_fold: The fold that this run tests.
        job: What was asked for.

    Raises:
        UserError: If ``frontier.run`` holds no finished frontier.
    """
    if finished is not None:
        overrides = _read(Path(finished).expanduser())["overrides"]
    else:
        run = job.directory / "frontier"
        if not (run / "results.json").is_file():  # a second choice may be another one
            given = [item for item in job.overrides if not item.startswith("task=")]
            asked = [*given, "task=frontier", f"crossval.only=[{test_fold}]"]
            frontier.run(read_config(job.compose(asked)), replace(job, directory=run))
        (choice,) = _read(run)["procedure"]["folds"]
        overrides = choice["overrides"]
    given = [item for item in job.overrides if not item.startswith("model=")]
    log.info("model=auto is %s.", " ".join(overrides))
    return read_config(job.compose(with_system(job, given, overrides)))


def _read(folder: Path) -> dict[str, Any]:
    path = folder / "results.json"
    try:
        results = read_record(path)
        return {key: results[key] for key in ("overrides", "procedure")}
    except (UserError, KeyError) as error:
        raise UserError(
            f"frontier.run={folder} holds no finished frontier; give the run folder of a "
            "task=frontier, or leave it out."
        ) from error
