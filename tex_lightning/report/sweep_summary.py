"""Summary of a sweep: its table on the screen, its file of rows, its charts and its page."""

from collections.abc import Sequence
from pathlib import Path

from tex_lightning.core.console import console
from tex_lightning.core.files import write_rows
from tex_lightning.data.recordings import natural_key
from tex_lightning.report.page import write_report
from tex_lightning.report.sweep import FAILURE
from tex_lightning.report.sweep_charts import draw_sweep
from tex_lightning.report.table import TINY, Table, is_tiny, make_table
from tex_lightning.report.trials import (
    JOB,
    TrialRow,
    assigned,
    columns,
    sweep_rows,
    sweep_table,
    swept_keys,
    told_figures,
)


def summarise(directory: Path, *, searched: bool) -> int:
    """Print and write the results of the jobs of a sweep.

    Args:
        directory: Folder of the sweep.
        searched: Whether a sweeper looked for the least objective.

    Returns:
        How many of its rows are not done.
    """
    marks = [*directory.glob("*/.hydra/overrides.yaml"), *directory.glob(f"*/{FAILURE}")]
    jobs = sorted({directory / mark.relative_to(directory).parts[0] for mark in marks})
    jobs.sort(key=lambda path: natural_key(path.name))
    rows = sweep_rows(jobs, searched=searched)
    keys = swept_keys(rows)
    lines = [{**row, **assigned(row), "overrides": " ".join(row["overrides"])} for row in rows]
    known = columns()
    headings = [*(key for key in keys if key not in known), *known]
    cells = ([line.get(heading) for heading in headings] for line in lines)
    write_rows(directory / "sweep.csv", headings, ([*map(_written, line)] for line in cells))
    table = sweep_table(rows, searched=searched)
    _print(table, rows, directory)
    draw_sweep(rows, directory, searched=searched)
    write_report(directory, jobs, [table])
    return sum(row["status"] != "done" for row in rows)


def _written(cell: object) -> object:
    return "" if cell is None else cell


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
