"""``python -m tex_lightning``: compose the configuration, check it, run one task."""

import logging
import os
import sys
import traceback
from pathlib import Path

INTERRUPTED = 130

try:
    import hydra
    from omegaconf import DictConfig, OmegaConf

    from tex_lightning.config import CONF, register
    from tex_lightning.config.composition import Job, current_job, quote_files, split_flags
    from tex_lightning.config.search import use_config_dir, with_own_senses
    from tex_lightning.config.usage import answer, asks
    from tex_lightning.core.console import fresh_screen, say
    from tex_lightning.core.contract import fault_of
    from tex_lightning.core.progress import finishing
    from tex_lightning.core.ranks import is_rank_zero, join_quietly
    from tex_lightning.errors import UserError
    from tex_lightning.launch import as_mistake
except KeyboardInterrupt:  # Ctrl-C before anything has begun
    print("Interrupted.", file=sys.stderr)
    raise SystemExit(INTERRUPTED) from None

USER_FAULT = 2
FAILED = 1

# Of every job of this process its run folder, and the override that goes on with it; none means
# that Hydra could not make a run folder.
STARTED: list[tuple[Path, str]] = []

log = logging.getLogger(__name__)


def run_job(composed: DictConfig) -> float | None:
    """Run one composed job; a sweep goes on whatever becomes of it.

    Returns:
        What a sweeper that searches is to minimise; None of a job that failed or trains nothing.
    """
    # Heavy imports wait until the command line is known to be right.
    from tex_lightning.dispatch import run_task
    from tex_lightning.report.sweep import FAILURE, note_failure

    job = current_job()
    STARTED.append((job.directory, _goes_on(job)))
    (job.directory / FAILURE).unlink(missing_ok=True)
    try:
        return run_task(composed, job)
    except Exception as error:
        mistake = as_mistake(error, job.overrides, began=True)
        if job.origin != "sweep":
            if mistake is None:
                raise
            raise SystemExit(complain(mistake)) from error
        if mistake is None:
            log.exception("This job of the sweep failed.")
        note_failure(job, _summary(error, mistake))
        return None


def _summary(error: Exception, mistake: Exception | None) -> str:
    """What the table of a sweep says of a failed job."""
    fault = fault_of(error)
    return str(mistake or (fault and fault[0]) or f"{type(error).__name__}: {error}")


def complain(error: Exception) -> int:
    """Print a user's mistake in one sentence and return the exit status for it."""
    if is_rank_zero():
        say(f"Error: {error}")
    return USER_FAULT


def main() -> int:
    """Run the command line and return its exit status."""
    try:
        return _main()
    except KeyboardInterrupt:
        if is_rank_zero():
            say(_interrupted())
        return INTERRUPTED
    except Exception as error:
        if (fault := fault_of(error)) is None:
            raise
        if is_rank_zero():
            said, where = fault
            say(f"Error: {said}")
            error.__notes__.clear()
            traceback.print_exception(type(error), error, where)
        return FAILED


def _interrupted() -> str:
    """What to say after Ctrl-C: how to go on with what is there."""
    from tex_lightning.core.run_folder import holds_work

    for directory, override in reversed(STARTED):
        if holds_work(directory):
            again = f"the same command with {override}"
            return f"Interrupted; {again} goes on after the last finished epoch."
    return "Interrupted."


def _goes_on(job: Job) -> str:
    if job.origin == "sweep":
        return f"hydra.sweep.dir={OmegaConf.select(job.hydra, 'hydra.sweep.dir')}"
    return f"hydra.run.dir={job.directory}"


def _main() -> int:
    # Hydra then raises its errors instead of printing and exiting with status 1.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    STARTED.clear()
    try:
        use_config_dir(sys.argv[1:])
    except UserError as error:
        return complain(error)
    if asks(sys.argv[1:]):
        return _answer(sys.argv[1:])
    if not is_rank_zero():
        join_quietly()
        sys.argv.append("hydra/job_logging=none")
    return _run()


def _answer(arguments: list[str]) -> int:
    """Print what the command line asks to read and return the exit status."""
    try:
        print(answer(arguments, CONF), flush=True)
    except BrokenPipeError:  # of `| head`; Python would complain once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    except Exception as error:
        mistake = as_mistake(error, [item for item in arguments if not asks([item])], began=False)
        if mistake is None:
            raise
        return complain(mistake)
    return 0


def _run() -> int:
    """Run the command line and return its exit status."""
    register()
    try:
        flags, overrides = split_flags(sys.argv[1:])
    except UserError as error:
        return complain(error)
    overrides = with_own_senses(quote_files(overrides))
    sys.argv[1:] = [*flags, *overrides]
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run_job)
    try:
        with fresh_screen(), finishing():
            entry()
    except Exception as error:
        mistake = as_mistake(error, overrides, began=bool(STARTED))
        if mistake is None:
            raise
        return complain(mistake)
    from tex_lightning.report.sweep import SweepSummary

    failures, SweepSummary.failures = SweepSummary.failures, 0  # the next call starts afresh
    return FAILED if failures else 0


if __name__ == "__main__":
    sys.exit(main())
