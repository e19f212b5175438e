"""``model=auto``: the configuration of the system that task=frontier found to be enough."""

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import cast

from tex_lightning.config import Config
from tex_lightning.config.job import Job
from tex_lightning.config.weights import read_config
from tex_lightning.errors import UserError
from tex_lightning.runs.family import with_system
from tex_lightning.tasks import frontier

log = logging.getLogger(__name__)


def resolve_auto(config: Config, job: Job) -> Config:
    """Replace ``model=auto`` by the chosen system of a family.

    Without ``frontier.run`` the family is measured here: tested on the validation fold, or on the
    fold after the one that this run tests, whose recordings take no part in the choice.

    Raises:
        UserError: If ``frontier.run`` holds no finished frontier.
    """
    run = job.directory / "frontier"
    if config.frontier.run is not None:
        run = Path(config.frontier.run).expanduser()
    elif not (run / "results.json").is_file():  # a second choice may be another one
        tested, watched = cast(int, config.data.test_fold), config.data.val_fold
        fold = (tested + 1) % config.data.folds if watched is None else watched
        only = replace(config.crossval, only=[fold])
        measured = replace(config, task="frontier", crossval=only)
        frontier.run(measured, replace(job, directory=run), excluded=tested)
    overrides = _read_choice(run)
    given = [item for item in job.overrides if not item.startswith("model=")]
    log.info("model=auto is %s.", " ".join(overrides))
    return read_config(job.compose(with_system(job, given, overrides)))


def _read_choice(folder: Path) -> list[str]:
    path = folder / "results.json"
    try:
        overrides: list[str] = json.loads(path.read_text(encoding="utf-8"))["overrides"]
    except (OSError, ValueError, KeyError) as error:
        raise UserError(
            f"frontier.run={folder} holds no finished frontier; give the run folder of a "
            "task=frontier, or leave it out."
        ) from error
    return overrides
