"""Run one job from its overrides to its results, for the command line and Python."""

import errno
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from omegaconf import DictConfig

from tex_lightning.config import CONF, SILENT
from tex_lightning.config.composition import current_job, quote_files, run_composed
from tex_lightning.config.mistakes import MISTAKES, explain
from tex_lightning.config.search import split_config_dir, use_config_dir
from tex_lightning.core.contract import fault_of
from tex_lightning.core.files import UNWRITABLE, unwritable
from tex_lightning.core.ranks import is_rank_zero
from tex_lightning.errors import UserError, shorten

if TYPE_CHECKING:
    from tex_lightning.learning.inputs import InputData


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

    def run(composed: DictConfig) -> Results:
        if composed.task in SILENT:
            raise UserError(
                f"task={composed.task} leaves no results; run it by python -m tex_lightning, or "
                "classify with tex_lightning.load."
            )
        from tex_lightning.dispatch import run_task  # imports PyTorch

        job = current_job(python=True)
        run_task(composed, job)
        file = job.directory / "results.json"
        content = json.loads(file.read_text(encoding="utf-8")) if is_rank_zero() else {}
        return Results(content, job.directory)

    results: Results = _run(run, overrides)
    return results


def data(*overrides: str) -> "InputData":
    """Read, decode and divide recordings, for a network and a Lightning Trainer of one's own.

    Args:
        *overrides: As for :func:`train`; ``model=NAME`` says which inputs are made, and
            ``data.test_fold`` and ``data.val_fold`` which recordings are left out of training.

    Returns:
        A ``LightningDataModule`` whose batches are pairs of inputs and labels, see
        :class:`~tex_lightning.learning.inputs.InputData`.

    Raises:
        UserError: With the sentence that the command line would print.
    """

    def run(composed: DictConfig) -> "InputData":
        from tex_lightning.dispatch import settled_config  # imports PyTorch
        from tex_lightning.studies.fold import fold_data

        config, _, job = settled_config(composed, current_job(python=True))
        if config.task != "fit" or config.model.baseline is not None:
            raise UserError(
                "tl.data makes the inputs of a network for training; give a model that is one, "
                "and no task."
            )
        return fold_data(config, job.directory)

    with TemporaryDirectory() as folder:
        made: InputData = _run(run, [*overrides, f"hydra.run.dir={folder}"])
    return made


def _run(function: Callable[[DictConfig], Any], overrides: Sequence[str]) -> Any:  # noqa: ANN401
    """Call a function with what the overrides compose; raise mistakes as one sentence."""
    arguments = quote_files(split_config_dir(overrides)[1])
    for each in arguments:
        if each.startswith("-"):
            raise UserError(f"{shorten(each)} is for the command line; give overrides key=value.")
    began: list[bool] = []

    def run(composed: DictConfig) -> Any:  # noqa: ANN401
        began.append(True)
        return function(composed)

    try:
        use_config_dir(overrides)
        return run_composed(run, arguments)
    except Exception as error:
        mistake = as_mistake(error, arguments, began=bool(began))
        if mistake is None or mistake is error:
            raise
        raise mistake from error
    finally:
        use_config_dir([])


def as_mistake(error: Exception, arguments: Sequence[str], *, began: bool) -> UserError | None:
    """What of an error is the user's to mend; None if it is a fault of the program.

    Args:
        error: Error that ended the job.
        arguments: The overrides.
        began: Whether the job had a run folder; before, only its configuration can be wrong.
    """
    if isinstance(error, UserError):
        return error
    if fault_of(error) is not None:  # of the user's own code, which keeps its traceback
        return None
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
