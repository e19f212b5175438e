"""``python -m tex_lightning``: compose the configuration, check it, run one task."""

import logging
import os
import sys
import tempfile
from pathlib import Path

import hydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from tex_lightning.arguments import quote_files
from tex_lightning.distributed.place import follows
from tex_lightning.errors import UserError
from tex_lightning.schema import register

INSIDE = Path(__file__).parent / "conf"  # in an installed wheel
BESIDE = Path(__file__).parent.parent / "conf"  # in a checkout
CONF = INSIDE if INSIDE.is_dir() else BESIDE

USER_FAULT = 2
FAILED_SWEEP = 1
INTERRUPTED = 130

MISTAKES = (HydraException, OmegaConfBaseException)

STARTED: list[Path] = []  # run folders of this process; none means that Hydra could not make one

log = logging.getLogger(__name__)


def run_job(composed: DictConfig) -> None:
    """Run one composed job; a sweep goes on whatever becomes of it."""
    # Heavy imports wait until the command line is known to be right.
    from tex_lightning.report.sweep import FAILURE, note_failure
    from tex_lightning.tasks.dispatch import run_task

    sweeping = HydraConfig.get().mode == RunMode.MULTIRUN
    directory = Path(HydraConfig.get().runtime.output_dir)
    STARTED.append(directory)
    (directory / FAILURE).unlink(missing_ok=True)
    try:
        status = run_task(composed, directory)
    except UserError as error:
        if not sweeping:
            raise SystemExit(complain(error)) from error
        note_failure(directory, str(error))
    except Exception as error:
        if not sweeping:
            raise
        log.exception("This job of the sweep failed.")
        note_failure(directory, f"{type(error).__name__}: {error}")
    else:
        if status:
            raise SystemExit(status)


def complain(error: Exception) -> int:
    """Print a user's mistake in one sentence and return the exit status for it."""
    if not follows():
        print(f"Error: {error}", file=sys.stderr)
    return USER_FAULT


def main() -> int:
    """Run the command line and return its exit status."""
    # Hydra then raises its errors instead of printing and exiting with status 1.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    STARTED.clear()
    if follows():
        with tempfile.TemporaryDirectory() as unused:
            return _run([f"hydra.run.dir={unused}", "hydra/job_logging=none"])
    return _run([])


def _run(more: list[str]) -> int:
    """Run the command line with ``more`` arguments and return its exit status."""
    sys.argv[1:] = [*quote_files(sys.argv[1:]), *more]
    register()
    entry = hydra.main(version_base="1.3", config_path=str(CONF), config_name="config")(run_job)
    try:
        entry()
    except (*MISTAKES, ValueError) as error:  # that of a group set to null, before a run begins
        from tex_lightning.mistakes import explain

        if STARTED and not isinstance(error, MISTAKES):
            raise
        return complain(explain(error, sys.argv[1:], CONF))
    except OSError as error:
        if STARTED:
            raise
        return complain(
            UserError(f"The run folder cannot be made ({error}); choose another hydra.run.dir.")
        )
    except KeyboardInterrupt:
        from tex_lightning.runfolder import holds_work

        if STARTED and not follows() and holds_work(STARTED[-1]):
            again = f"the same command with hydra.run.dir={STARTED[-1]}"
            print(f"Interrupted; {again} goes on after the last finished epoch.", file=sys.stderr)
        return INTERRUPTED
    from tex_lightning.report.sweep import SweepSummary

    failures, SweepSummary.failures = SweepSummary.failures, 0  # the next call starts afresh
    return FAILED_SWEEP if failures else 0


if __name__ == "__main__":
    sys.exit(main())
