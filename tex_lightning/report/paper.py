"""The paper's results, for tables that show them beside this package's."""

from pathlib import Path
from typing import Any

from omegaconf import OmegaConf

PAPER = Path(__file__).with_name("paper.yaml")


def paper_table(name: str) -> dict[str, Any]:
    """One table of the paper, as it stands in ``paper.yaml``; empty if it has none of this name."""
    tables: Any = OmegaConf.to_container(OmegaConf.load(PAPER))
    found: dict[str, Any] = tables.get(name, {})
    return found
