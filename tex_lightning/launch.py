"""Run one job from its overrides to its results, for the command line and Python."""

import errno
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from omegaconf import DictConfig

from tex_lightning.config import CONF, SILENT
from tex_lightning.config.arguments import quote_files
from tex_lightning.config.composition import run_composed
from tex_lightning.config.job import current_job
from tex_lightning.config.mistakes import MISTAKES, explain
from tex_lightning.errors import UserError, shorten
from tex_lightning.files import UNWRITABLE, unwritable
from tex_lightning.ranks import is_rank_zero


class Results(dict[str, Any]):
    """The content of ``results.json``, and where the rest of the run lies.

    Attributes:
        folder: The run folder, with checkpoints, figures and predictions; :func:`load` takes it.

    Example:
        >>> import tex_lightning as tl
        >>> results = tl.Results({"task": "fit"}, folder="outputs/run")
        >>> results["task"], results.folder.name
        ('fit', 'run')
    """

    def __init__(self, content: dict[str, Any], folder: str | Path) -> None:
        super().__init__(content)
        self.folder = Path(folder)


def train(*overrides: str) -> Results:
    """Train and test what the command line would, in this process.

    Logging, the working directory and Hydra's state are left as they are. A run folder that holds
    an unfinished run of the same settings is gone on with.

    Args:
        *overrides: What follows ``python -m tex_lightning``, such as ``"model=haptic"``,
            ``"data=folder"``, ``"data.root=DIR"``, ``"task=crossval"`` or ``"hydra.run.dir=RUN"``,
            without which a new folder is made below ``outputs``.

    Returns:
        What the run has written to ``results.json``; empty in a process that is not rank zero.

    Raises:
        UserError: With the sentence that the command line would print.

    Example:
        >>> import tex_lightning as tl
        >>> results = tl.train("model=mfcc_nb", "data=folder", "data.root=DIR")
        >>> results["networks"]["haptic"]["correct"]
        3
        >>> model = tl.load(results.folder)
    """
    arguments = quote_files(overrides)
    for each in arguments:
        if each.startswith("-"):
            raise UserError(f"{shorten(each)} is for the command line; give overrides key=value.")
    folders: list[Path] = []

    def run(composed: DictConfig) -> Results:
        if composed.task in SILENT:
            raise UserError(
                f"task={composed.task} leaves no results; run it by python -m tex_lightning, or "
                "classify with tex_lightning.load."
            )
        from tex_lightning.dispatch import run_task  # imports PyTorch

        job = current_job(python=True)
        folders.append(job.directory)
        run_task(composed, job)
        file = job.directory / "results.json"
        content = json.loads(file.read_text(encoding="utf-8")) if is_rank_zero() else {}
        return Results(content, job.directory)

    try:
        results: Results = run_composed(run, arguments)
    except Exception as error:
        mistake = as_mistake(error, arguments, began=bool(folders))
        if mistake is None or mistake is error:
            raise
        raise mistake from error
    return results


def as_mistake(error: Exception, arguments: Sequence[str], *, began: bool) -> UserError | None:
    """What of an error is the user's to mend; None if it is a fault of the program.

    Args:
        error: Error that ended the job.
        arguments: The overrides.
        began: Whether the job had a run folder; before, only its configuration can be wrong.
    """
    if isinstance(error, UserError):
        return error
    if isinstance(error, MISTAKES):
        return explain(error, arguments, CONF)
    if began:
        if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
            return UserError(f"The path {shorten(error.filename)} is too long; give a shorter one.")
        if isinstance(error, OSError) and error.errno in UNWRITABLE:
            return unwritable(shorten(error.filename or "a file of this run"), error)
        return None
    # also of a group set to null
    if isinstance(error, ValueError | OverflowError | RecursionError):
        return explain(error, arguments, CONF)
    if isinstance(error, OSError):
        if "conf" in Path(error.filename or "").parts:  # of an option that Hydra looks for
            return explain(error, arguments, CONF)
        return UserError(
            f"The run folder cannot be made ({shorten(error)}); choose another hydra.run.dir."
        )
    return None
