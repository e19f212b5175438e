"""``python -m tex_lightning``: compose the configuration, check it, run one task."""

import errno
import logging
import os
import sys
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig

from tex_lightning.config import CONF, register
from tex_lightning.config.arguments import quote_files
from tex_lightning.config.mistakes import MISTAKES, explain
from tex_lightning.config.usage import answer, asks
from tex_lightning.errors import UserError, shorten
from tex_lightning.ranks import is_rank_zero, join_quietly

USER_FAULT = 2
FAILED_SWEEP = 1
INTERRUPTED = 130

STARTED: list[Path] = []  # run folders of this process; none means that Hydra could not make one

log = logging.getLogger(__name__)


def run_job(composed: DictConfig) -> float | None:
    """Run one composed job; a sweep goes on whatever becomes of it.

    Returns:
        What a sweeper that searches is to minimise; None of a job that failed or trains nothing.
    """
    # Heavy imports wait until the command line is known to be right.
    from tex_lightning.dispatch import run_task
    from tex_lightning.report.sweep import FAILURE, note_failure

    sweeping = HydraConfig.get().mode == RunMode.MULTIRUN
    directory = Path(HydraConfig.get().runtime.output_dir)
    STARTED.append(directory)
    (directory / FAILURE).unlink(missing_ok=True)
    try:
        return run_task(composed, directory)
    except Exception as error:
        mistake = _mistake(error)
        if not sweeping:
            if mistake is None:
                raise
            raise SystemExit(complain(mistake)) from error
        if mistake is None:
            log.exception("This job of the sweep failed.")
        note_failure(directory, str(mistake or f"{type(error).__name__}: {error}"))
        return None


def _mistake(error: Exception) -> UserError | None:
    """What of an error is the user's to mend; None if it is a fault of the program."""
    if isinstance(error, OSError) and error.errno == errno.ENAMETOOLONG:
        return UserError(f"The path {shorten(error.filename)} is too long; give a shorter one.")
    return error if isinstance(error, UserError) else None


def complain(error: Exception) -> int:
    """Print a user's mistake in one sentence and return the exit status for it."""
    if is_rank_zero():
        print(f"Error: {error}", file=sys.stderr)
    return USER_FAULT


def main() -> int:
    """Run the command line and return its exit status."""
    # Hydra then raises its errors instead of printing and exiting with status 1.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    STARTED.clear()
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
    except UserError as error:
        return complain(error)
    except (*MISTAKES, ValueError, OverflowError) as error:
        return complain(explain(error, [item for item in arguments if not asks([item])], CONF))
    except BrokenPipeError:  # of `| head`; Python would complain once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _run() -> int:
    """Run the command line and return its exit status."""
    sys.argv[1:] = quote_files(sys.argv[1:])
    register()
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run_job)
    try:
        entry()
    except (*MISTAKES, ValueError, OverflowError) as error:  # also of a group set to null
        if STARTED and not isinstance(error, MISTAKES):
            raise
        return complain(explain(error, sys.argv[1:], CONF))
    except OSError as error:
        if STARTED:
            raise
        if "conf" in Path(error.filename).parts:  # of an option that Hydra looks for
            return complain(explain(error, sys.argv[1:], CONF))
        return complain(
            UserError(
                f"The run folder cannot be made ({shorten(error)}); choose another hydra.run.dir."
            )
        )
    except KeyboardInterrupt:
        from tex_lightning.runfolder import holds_work

        if STARTED and is_rank_zero() and holds_work(STARTED[-1]):
            again = f"the same command with hydra.run.dir={STARTED[-1]}"
            print(f"Interrupted; {again} goes on after the last finished epoch.", file=sys.stderr)
        return INTERRUPTED
    from tex_lightning.report.sweep import SweepSummary

    failures, SweepSummary.failures = SweepSummary.failures, 0  # the next call starts afresh
    return FAILED_SWEEP if failures else 0


if __name__ == "__main__":
    sys.exit(main())
