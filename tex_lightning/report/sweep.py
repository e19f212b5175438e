"""Summary of a sweep: its table, its files, and its failures."""

import json
import logging
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, ClassVar

from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config.composition import Job
from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.core.console import NORMAL, Screen, console, say
from tex_lightning.core.files import write_rows, write_text
from tex_lightning.core.run_folder import locked_folder
from tex_lightning.data.recordings import natural_key
from tex_lightning.errors import UserError
from tex_lightning.report.table import TINY, Table, is_tiny, make_table
from tex_lightning.report.trials import (
    FAILURE,
    JOB,
    TrialRow,
    assigned,
    columns,
    sweep_rows,
    sweep_table,
    swept_keys,
    told_figures,
)

log = logging.getLogger(__name__)

ALL_COMBINATIONS = "hydra._internal.core_plugins.basic_sweeper.BasicSweeper"
ONE_BY_ONE = "hydra._internal.core_plugins.basic_launcher.BasicLauncher"
NO_SWEEP = (
    "A sweep runs every job in one process; leave out trainer=ddp, trainer.devices and "
    "trainer.num_nodes, or run without -m."
)


def note_failure(job: Job, reason: str) -> None:
    """Write the reason of a failure into the job's folder, for the summary and the user."""
    log.error("%s", reason)
    text = json.dumps({"error": reason, "overrides": job.overrides}, indent=1)
    write_text(job.directory / FAILURE, text)


@contextmanager
def _as_exit() -> Iterator[None]:
    """Convert a user's mistake to the command line's message."""
    try:
        yield
    except UserError as error:
        say(f"Error: {error}")
        raise SystemExit(2) from error


class SweepSummary(Callback):
    """Print and write ``sweep.csv`` in the sweep's folder when all jobs have run."""

    failures: ClassVar[int] = 0

    def __init__(self) -> None:
        self._running = ExitStack()

    def __reduce__(self) -> tuple[type["SweepSummary"], tuple[()]]:
        """Return the pickled form for the processes of a launcher, without the lock."""
        return SweepSummary, ()

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401
        """Reject settings that no job of a sweep can run with, before the first one.

        Raises:
            SystemExit: Hydra turns other exceptions of callbacks into warnings.
        """
        # its end reads checkpoints, and a launcher may run the jobs in other processes
        chosen: Any = OmegaConf.to_container(config)
        trust(*chosen["trusted"], *named_classes(chosen["model"]))
        trainer = OmegaConf.select(config, "trainer")
        with _as_exit():
            if (trainer.devices, trainer.num_nodes) != (1, 1):
                raise UserError(NO_SWEEP)
            self._running.enter_context(locked_folder(_folder(config), "hydra.sweep.dir"))
        verbose = OmegaConf.select(config, "verbose")
        Screen.verbose = verbose if isinstance(verbose, int) else NORMAL  # it may be swept

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:  # noqa: ANN401
        """Release a job's configuration, half a megabyte that Hydra would keep."""
        job_return.cfg = job_return.hydra_cfg = None

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:  # noqa: ANN401
        """Collect the results of the jobs.

        Raises:
            SystemExit: If it cannot be written.
        """
        with self._running, _as_exit():
            _summarise(_folder(config), searched=is_search(config))


def _folder(config: DictConfig) -> Path:
    return Path(str(OmegaConf.select(config, "hydra.sweep.dir"))).resolve()


def _summarise(directory: Path, *, searched: bool) -> None:
    marks = [*directory.glob("*/.hydra/overrides.yaml"), *directory.glob(f"*/{FAILURE}")]
    jobs = sorted({directory / mark.relative_to(directory).parts[0] for mark in marks})
    jobs.sort(key=lambda path: natural_key(path.name))
    rows = sweep_rows(jobs, searched=searched)
    SweepSummary.failures = sum(row["status"] != "done" for row in rows)
    keys = swept_keys(rows)
    lines = [{**row, **assigned(row), "overrides": " ".join(row["overrides"])} for row in rows]
    known = columns()
    headings = [*(key for key in keys if key not in known), *known]
    cells = ([line.get(heading) for heading in headings] for line in lines)
    write_rows(directory / "sweep.csv", headings, ([*map(_written, line)] for line in cells))
    table = sweep_table(rows, searched=searched)
    _print(table, rows, directory)
    # heavy, and only now needed
    from tex_lightning.report.page import write_report
    from tex_lightning.report.sweep_charts import draw_sweep

    draw_sweep(rows, directory, searched=searched)
    write_report(directory, jobs, [table])


def _written(cell: object) -> object:
    return "" if cell is None else cell


def is_search(config: DictConfig) -> bool:
    """Return whether a sweeper looks for the least objective, and does not try each combination."""
    target = OmegaConf.select(config, "hydra.sweeper._target_")
    return target is not None and str(target) != ALL_COMBINATIONS


def runs_side_by_side(config: DictConfig) -> bool:
    """Return whether a launcher runs the jobs of a sweep in processes of their own."""
    return str(OmegaConf.select(config, "hydra.launcher._target_")) != ONE_BY_ONE


def _print(table: Table, rows: Sequence[TrialRow], directory: Path) -> None:
    """Print a line for each row that is shown, failures, and where the files are."""
    right = {heading for row in rows for heading in told_figures(row, searched=False)}
    one = len({row["network"] for row in rows if "network" in row}) == 1
    headings = [name for name in table.headings if not (one and name == "network")]
    shown = [name for name in headings if name not in right]
    figures = [name for name in headings if name in right]
    screen = make_table("sweep", shown, figures)
    for row in table.rows:
        screen.add_row(*(row.get(name, "") for name in (*shown, *figures)))
    console.print(screen)
    for row in rows:
        if row["status"] != "done":
            console.print(f"Job {row[JOB]}: {row['status']}", soft_wrap=True)
    if any(is_tiny(row["overrides"]) for row in rows):
        console.print(TINY, style="bold yellow")
    console.print(f"Summary in {directory / 'sweep.csv'}", soft_wrap=True)
