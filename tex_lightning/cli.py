"""Compose, check and run one task, for the command line and for :func:`tex_lightning.train`.

A command goes through :func:`main`, Hydra, :func:`run_job` and :func:`run_task`, which checks the
configuration (:mod:`tex_lightning.config.check`), derives settings from the recordings
(:mod:`tex_lightning.data.derived_settings`) and calls ``run`` of ``tasks/NAME.py``. PyTorch is
imported once the command line is known to be right.
"""

import logging
import os
import sys
import time
import traceback
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from threading import RLock
from typing import Any

import hydra
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import CONF, SILENT, Config, Job, flatten, plain_values, register
from tex_lightning.config.check import checked_config
from tex_lightning.config.composition import as_composed, current_job, run_composed, split_flags
from tex_lightning.config.help_text import requested_help
from tex_lightning.config.mistakes import check_choices, to_user_error
from tex_lightning.config.overrides import key_of, parsed_overrides
from tex_lightning.config.tasks import NO_FOLDER, TRAINING
from tex_lightning.config.user_folders import use_config_dir
from tex_lightning.core.console import Screen, console, say, show_rank_zero, verbosity
from tex_lightning.core.contract import fault_of
from tex_lightning.core.progress import ending_stages
from tex_lightning.core.ranks import is_rank_zero, requeueing
from tex_lightning.core.run_folder import (
    FAILURE,
    claim_folder,
    find_checkpoint,
    holds_work,
    locked_folder,
    note_failure,
    read_results,
    remove_if_empty,
    write_results,
)
from tex_lightning.errors import UserError
from tex_lightning.learning.processes import prepared, quick_import

FAILED, USER_FAULT, INTERRUPTED = 1, 2, 130  # exit statuses
PATIENCE = 10.0  # seconds by which processes that were started together may differ

# The run folder of each job of this process, and the override that continues it. It is empty if
# Hydra could not make a run folder.
STARTED: list[tuple[Path, str]] = []

RUN_LOCK = RLock()  # one run at a time: Hydra's state, logging and threads belong to the process

log = logging.getLogger(__name__)


class Results(dict[str, Any]):
    """The content of ``results.json``, and the run folder.

    Attributes:
        folder: The run folder, with checkpoints, figures and predictions;
            :func:`tex_lightning.load` takes it.

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
    """Run a command line in this process.

    Logging, the working directory, Hydra's state and PyTorch's threads are left as they are. An
    unfinished run of the same settings in the run folder is continued. One run of a process waits
    for another.

    Args:
        *overrides: Arguments after ``python -m tex_lightning``, such as ``"model=haptic"``,
            ``"data=folder"``, ``"data.root=DIR"``, ``"task=crossval"`` or ``"hydra.run.dir=RUN"``;
            by default the run folder is a new one below ``outputs``.

    Returns:
        The content of ``results.json``; empty in a process that is not rank zero.

    Raises:
        UserError: With the sentence that the command line would print.

    Example:
        >>> import tex_lightning as tl
        >>> results = tl.train("model=mfcc_nb", "data=folder", "data.root=DIR")
        >>> results["networks"]["haptic"]["correct"]
        3
        >>> model = tl.load(results.folder)
    """
    began: list[Job] = []

    def run(composed: DictConfig) -> Results:
        began.append(job := current_job(composed, python=True))
        if composed.task in SILENT:
            raise UserError(
                f"task={composed.task} leaves no results; run it by python -m tex_lightning, or "
                "classify with tex_lightning.load."
            )
        with quick_import():
            from tex_lightning.core.devices import torch_defaults
        with torch_defaults():
            run_task(job)
        return Results(read_results(job.directory) if is_rank_zero() else {}, job.directory)

    with RUN_LOCK:
        try:
            results: Results = run_composed(run, use_config_dir(overrides))
        except Exception as error:
            if began and not began[0].named:
                remove_if_empty(began[0].directory)
            mistake = to_user_error(error, began=bool(began))
            if mistake is None or mistake is error:
                raise
            raise mistake from error
        finally:
            use_config_dir([])
    return results


def main() -> int:
    """Run the command line and return its exit status."""
    # Hydra then raises its errors instead of printing and exiting with status 1
    os.environ["HYDRA_FULL_ERROR"] = "1"
    STARTED.clear()
    arguments = sys.argv[1:]
    try:
        use_config_dir(arguments)
        if text := requested_help(arguments):
            print(text, flush=True)
            return 0
        return _run(arguments)
    except KeyboardInterrupt:
        return _report_interrupt()
    except BrokenPipeError:  # of `| head`; Python would complain once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if _follows_interrupt(error):
            return _report_interrupt()
        if (status := _report_error(error, began=bool(STARTED))) is None:
            raise
        return status


def _follows_interrupt(error: BaseException | None) -> bool:
    """Return whether Ctrl-C, as in the midst of a change of Hydra's, has led to an error."""
    while error and not isinstance(error, KeyboardInterrupt):
        error = error.__cause__ or error.__context__
    return error is not None


def _report_interrupt() -> int:
    """Print how to continue the run and return the exit status of Ctrl-C."""
    if is_rank_zero():
        say(_how_to_continue())
    return INTERRUPTED


def _report_error(error: Exception, *, began: bool) -> int | None:
    """Print what ended a command and return its exit status; None if it is a fault of the program.

    What a user's own class raised keeps its traceback, after one line that names its key.
    """
    if mistake := to_user_error(error, began=began):
        return complain(mistake)
    if (fault := fault_of(error)) is None:
        return None
    complain(fault)
    if is_rank_zero():
        error.__notes__.clear()
        traceback.print_exception(error)
    return FAILED


def complain(error: object) -> int:
    """Print a user's mistake in one sentence and return its exit status.

    Of processes that train together, rank zero prints it, and their launcher then ends the others.
    A process that is still running after a while prints its own.
    """
    if not is_rank_zero():
        time.sleep(PATIENCE)
        console.quiet = False
    say(f"Error: {error}")
    return USER_FAULT


def _run(arguments: Sequence[str]) -> int:
    """Run the jobs of the command line and return its exit status."""
    try:
        Path.cwd()
    except FileNotFoundError as error:  # which Hydra would take for a fault of the run folder
        raise UserError("The current folder was deleted; change to one that is there.") from error
    register()
    flags, overrides = split_flags(arguments)
    if not is_rank_zero():
        show_rank_zero()
        overrides.append("hydra/job_logging=none")
    sys.argv[1:] = [*flags, *as_composed(overrides)]
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run_job)
    with ending_stages():
        entry()
    from tex_lightning.report.sweep import SweepSummary

    failures, SweepSummary.failures = SweepSummary.failures, 0  # the next call starts afresh
    return FAILED if failures else 0


def _how_to_continue() -> str:
    """Return the message after Ctrl-C: how to continue the run."""
    for directory, override in reversed(STARTED):
        if override and holds_work(directory):
            again = f"the same command with {override}"
            return f"Interrupted; {again} goes on after the last finished epoch."
    return "Interrupted."


def run_job(composed: DictConfig) -> float | None:
    """Run one composed job; a sweep continues even if it fails.

    Returns:
        The objective that a search minimises; None for a job that failed or trains nothing.
    """
    job = current_job(composed)
    swept = job.origin == "sweep"
    if swept:
        _check_search(job)
        (job.directory / FAILURE).unlink(missing_ok=True)
    place = OmegaConf.select(job.hydra, "hydra.sweep.dir") if swept else job.directory
    again = "" if composed.task in NO_FOLDER else f"{job.folder_key}={place}"
    STARTED.append((job.directory, again))
    try:
        return run_task(job)
    except Exception as error:
        if _follows_interrupt(error):  # which ends a sweep, too
            raise KeyboardInterrupt from error
        if not swept:
            if not job.named:
                remove_if_empty(job.directory)
            if (status := _report_error(error, began=True)) is None:
                raise
            raise SystemExit(status) from error  # else Hydra would print a line of its own
        if (mistake := to_user_error(error, began=True)) is None:
            log.exception("This job of the sweep failed.")
        message = mistake or fault_of(error) or f"{type(error).__name__}: {error}"
        note_failure(job.directory, job.overrides, str(message))
        return None


def _check_search(job: Job) -> None:
    """End a search for settings that could only be chosen by their test accuracy.

    Raises:
        SystemExit: After the message, since every other job would fail as well.
    """
    from tex_lightning.report.sweep import is_search

    validated = job.composed.task == "fit" and job.composed.data.val_fold is not None
    if is_search(job.hydra) and not validated:
        message = (
            f"A search (hydra/sweeper={job.hydra.hydra.runtime.choices.get('hydra/sweeper')}) "
            "chooses settings by the loss on a validation fold, and this one has none: chosen on "
            "the test fold, its accuracy would be too high; give task=fit data.val_fold=1, and "
            "test the settings that are found on the other folds."
        )
        raise SystemExit(complain(message))


def run_task(job: Job) -> float | None:
    """Check the configuration and run its task in the run folder of the job.

    In a training on several devices every process calls it; only rank zero writes files.

    Returns:
        The objective that a search minimises; None for a task that trains nothing.

    Raises:
        UserError: If the configuration or what it names cannot be used.
    """
    given = {key_of(each): each.value() for each in parsed_overrides(job.overrides)}
    lists = {key: x for key, x in given.items() if isinstance(x, list) and "." not in key}
    check_choices({**job.hydra.hydra.runtime.choices, **lists}, job.searchpath)
    # what is wrong with it is said before PyTorch is imported
    config = checked_config(job.composed, job.sets)
    from tex_lightning.data.derived_settings import derive_settings
    from tex_lightning.report.sweep import runs_side_by_side

    Screen.sweep = job.origin == "sweep"
    several = Screen.sweep and runs_side_by_side(job.hydra)
    Screen.job = f"Job {job.hydra.hydra.job.num}: " if several else ""
    config, job = derive_settings(config, job)
    if config.checkpoint is not None:
        config = replace(config, checkpoint=str(find_checkpoint(config.checkpoint)))
    with prepared(config, job):
        show_rank_zero(libraries=job.origin != "python")
        results = _run_in_folder(config, job)
    if config.task in TRAINING and results:
        from tex_lightning.evaluation.outcomes import optimized_value

        return optimized_value(results)
    return None


def _run_in_folder(config: Config, job: Job) -> dict[str, Any]:
    """Run a task in its locked run folder; write its results, if any, and the report."""
    locked = is_rank_zero() and config.task not in SILENT
    lock = locked_folder(job.directory) if locked else nullcontext()
    again = nullcontext() if config.task in SILENT else requeueing()
    with verbosity(config.verbose), ending_stages(), lock, again:
        if is_rank_zero() and config.task not in NO_FOLDER:
            values = flatten(plain_values(config))
            claim_folder(job.directory, values, job.record, job.folder_key)
        # a task is imported when it runs: most take Lightning, which predictions do without
        with quick_import():
            task = import_module(f"tex_lightning.tasks.{config.task}")
        results = task.run(config, job) or {}
        if results and locked:
            from tex_lightning.report.page import write_report

            write_results(job.directory, results)
            write_report(job.directory)
        return results
