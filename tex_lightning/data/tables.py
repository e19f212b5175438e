"""Small CSV tables that people write by hand or export from a spreadsheet."""

import csv
from pathlib import Path
from typing import Any

from tex_lightning.core.files import check_lines
from tex_lightning.errors import UserError, reason
from tex_lightning.text import from_cell

Record = dict[str, str]


def read_table(path: Path, what: str, needed: tuple[str, ...]) -> list[tuple[int, Record]]:
    """Read the records of a CSV file, with commas or semicolons, by the names in its first line.

    Args:
        path: An existing file.
        what: What to call it in messages.
        needed: Columns that it must have.

    Returns:
        Number of the line and record, for each.

    Raises:
        UserError: If it is no UTF-8 CSV, or a column is missing.
    """
    try:
        check_lines(path)
        with path.open(newline="", encoding="utf-8-sig") as stream:
            first = stream.readline()
            stream.seek(0)
            delimiter = ";" if ";" in first and "," not in first else ","
            reader = csv.DictReader(stream, delimiter=delimiter)
            names = [name.strip() for name in reader.fieldnames or ()]
            reader.fieldnames = names
            records = [
                (reader.line_num, {name: _text(cell) for name, cell in line.items()})
                for line in reader
            ]
    except (OSError, ValueError, csv.Error) as error:
        raise UserError(
            f"{what} {path} is not a UTF-8 CSV file ({reason(error)}); save it as CSV."
        ) from error
    missing = [column for column in needed if column not in names]
    if missing:
        raise UserError(
            f"{what} {path} lacks the column {', '.join(missing)}; "
            f"its first line must name {','.join(needed)}."
        )
    return records


def _text(cell: Any) -> Any:  # noqa: ANN401  (a short line has None, a long one a list)
    return from_cell(cell) if isinstance(cell, str) else cell
