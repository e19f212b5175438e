"""The paper's results, for tables that show them beside ours."""

from pathlib import Path
from typing import Any, cast

from omegaconf import OmegaConf

PAPER = Path(__file__).with_name("paper.yaml")


def paper_table(name: str) -> dict[str, Any]:
    """One table of the paper, as it stands in ``paper.yaml``."""
    tables = cast(dict[str, Any], OmegaConf.to_container(OmegaConf.load(PAPER)))
    return cast(dict[str, Any], tables[name])
