"""Progress bars and messages, all on standard error: standard output belongs to results."""

import os
from collections.abc import Iterable, Iterator, Sized
from typing import TypeVar

from rich.console import Console
from rich.progress import Progress

from tex_lightning.ranks import is_rank_zero

Item = TypeVar("Item")

console = Console(stderr=True, quiet=not is_rank_zero())
if not console.is_terminal and "COLUMNS" not in os.environ:
    # a log file has room for long names
    console = Console(stderr=True, width=120, quiet=console.quiet)


def track(items: Iterable[Item], title: str) -> Iterator[Item]:
    """Yield the items behind a progress bar that goes away when it is done."""
    total = len(items) if isinstance(items, Sized) else None
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        yield from bar.track(items, description=title, total=total)
