"""Files that cannot be used: all of them are listed at once, or left out on request."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from tex_lightning.data.recordings import Recording

MAX_LINES = 20


@dataclass(frozen=True)
class Unusable:
    """A recording that cannot be decoded, or gives no fragment.

    Attributes:
        recording: Its row in the table.
        reason: A sentence that names the file.
    """

    recording: Recording
    reason: str


def list_files(unusable: Sequence[Unusable]) -> list[str]:
    """A line for each file, up to a number that a terminal shows."""
    lines = [f"- {each.reason}" for each in unusable[:MAX_LINES]]
    if len(unusable) > MAX_LINES:
        lines.append(f"… and {len(unusable) - MAX_LINES} more")
    return lines


def skipped_entry(unusable: Iterable[Unusable]) -> list[dict[str, str]]:
    """Entry of ``results.json`` for the files that were left out."""
    return [{"path": each.recording.source, "reason": each.reason} for each in unusable]
