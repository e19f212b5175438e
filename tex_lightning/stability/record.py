"""Keep the decisions of finished trials on disk, from which an interrupted run continues."""

import json
from collections.abc import Sequence
from dataclasses import astuple
from pathlib import Path

from tex_lightning.errors import UserError
from tex_lightning.files import write_text
from tex_lightning.stability.evaluator import Decision

Key = tuple[str, str, float]  # system, perturbation, severity

RECORD = "trials.jsonl"


class Record:
    """One JSON line per trial, added when the trial is done.

    Args:
        path: The file; what it holds already is read. A last line that is cut off is left out.

    Raises:
        UserError: If another line is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.trials: dict[Key, list[Decision]] = {}
        if path.is_file():
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
            whole = [line for line in lines if line.endswith("\n")]
            if len(whole) < len(lines):
                write_text(path, "".join(whole))
            for number, line in enumerate(whole, start=1):
                try:
                    *key, made = json.loads(line)
                    system, perturbation, severity = key
                    self.trials[system, perturbation, severity] = [Decision(*one) for one in made]
                except (TypeError, ValueError) as error:
                    raise UserError(
                        f"Line {number} of {path} is damaged; delete that line and run the same "
                        "command again."
                    ) from error

    def add(self, key: Key, decisions: Sequence[Decision]) -> None:
        """Keep the decisions of one trial."""
        self.trials[key] = list(decisions)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps([*key, [astuple(each) for each in decisions]])
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")
