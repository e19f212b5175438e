"""YAML files from anywhere, looked at before they are read: aliases may stand for billions."""

from pathlib import Path

import yaml

from tex_lightning.errors import UserError, reason
from tex_lightning.files import is_file

MOST_NODES = 100_000  # that a file may stand for with its aliases; ours have some hundreds
MOST_BRACKETS = 5000
LARGEST = 1 << 20  # bytes


def check_yaml(path: Path) -> None:
    """Refuse a file that would take up all memory; other mistakes are told when it is read.

    Raises:
        UserError: If it is too large or stands for too much, or is no text.
    """
    try:
        if not is_file(path):
            raise ValueError("it is no file")
        if path.stat().st_size > LARGEST:
            raise ValueError("it is larger than 1 MiB")
        text = path.read_text(encoding="utf-8")
        if text.count("[") + text.count("{") > MOST_BRACKETS:  # within each other they take hours
            raise ValueError("it has too many brackets")
        # nodes are shared where aliases are, so that this stays as small as the file
        if _size(yaml.compose(text, yaml.SafeLoader), {}) > MOST_NODES:
            raise ValueError("its aliases stand for too much")
    except (OSError, ValueError, RecursionError) as error:
        raise UserError(f"File {path} cannot be read as YAML ({reason(error)}).") from error
    except yaml.YAMLError:
        return


def _size(node: yaml.Node | None, known: dict[int, int]) -> int:
    """How many nodes there are with every alias written out."""
    if not isinstance(node, yaml.CollectionNode):
        return 1
    if id(node) not in known:
        known[id(node)] = MOST_NODES  # as long as it is counted: it holds itself
        inner = [
            part for item in node.value for part in (item if isinstance(item, tuple) else [item])
        ]
        known[id(node)] = 1 + sum(_size(part, known) for part in inner)
    return known[id(node)]
