"""Escape text that comes from files for each medium: every name passes through here to be shown.

Classes, files, conditions and senses are called whatever their author likes. Before such a name
reaches a terminal, a figure, a document or a table, one of these functions takes from it what that
medium would not show as text.
"""

import json
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tex_lightning_runtime.errors import printable as printable

if TYPE_CHECKING:
    from jinja2 import Template

FORMULA = re.compile(
    r"'*[=+\-@]"
)  # what a spreadsheet computes, and what was marked as text before
# Punctuation that Markdown or HTML reads, of which some is plain inside of a word or line.
MARKDOWN = re.compile(
    r"[\\`*\[\]<>|~$]|^[#+=-]|&(?=[#\w])|:(?=//)|(?<=www)\.|(?<![^\W_])_|_(?![^\W_])"
)


def printable_lines(text: str) -> str:
    """Apply :func:`printable` to each line; tabs become blanks."""
    return "\n".join(map(printable, text.expandtabs(1).split("\n")))


def to_markdown(text: str) -> str:
    """Return Markdown in one line that shows the text as it is, without images, links or HTML."""
    return MARKDOWN.sub(r"\\\g<0>", printable(text))


def render(template: Path, context: Mapping[str, Any]) -> str:
    """Return a document by a template of Jinja, whose filters are the functions of this module.

    Args:
        template: Values are escaped in one that ends in ``.html``.
        context: Values by the names that the template uses.
    """
    return _compiled(template).render(context)


@cache
def _compiled(template: Path) -> "Template":
    from jinja2 import Environment, StrictUndefined  # slow, and only documents need it

    environment = Environment(
        autoescape=template.suffix == ".html",
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"md": to_markdown, "printable": printable}
    return environment.from_string(template.read_text(encoding="utf-8"))


def to_json(value: object) -> str:
    """Return JSON in readable letters; those that no terminal should get are escaped."""
    letters = json.dumps(value, ensure_ascii=False)
    if letters.isprintable():  # as almost always, and of a thousand classes there are many
        return letters
    return "".join(x if x.isprintable() else json.dumps(x)[1:-1] for x in letters)


def to_cell(value: Any) -> Any:  # noqa: ANN401  (numbers stay as they are)
    """Return a cell of a CSV that no spreadsheet computes and no terminal obeys.

    Text that begins like a formula gets an apostrophe before it, and text with control characters
    is written as a JSON string. :func:`from_cell` undoes both.
    """
    if not isinstance(value, str):
        return value
    if not value.isprintable() or value.startswith('"'):
        return json.dumps(value)
    return f"'{value}" if FORMULA.match(value) else value


def from_cell(cell: str) -> str:
    """Return the text that :func:`to_cell` made a cell of."""
    if cell.startswith('"'):
        try:
            return str(json.loads(cell))
        except ValueError:  # somebody else's cell
            return cell
    return cell[1:] if cell.startswith("'") and FORMULA.match(cell) else cell
