"""The job beside its configuration: overrides, run folder, one job or many."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import CONF
from tex_lightning.config.composition import compose_config

Origin = Literal["command", "sweep", "python"]

RUN_FOLDER = "hydra.run.dir="
ASKED_FOR = ("command-line", "hydra.searchpath in command-line")  # providers of further folders


@dataclass(frozen=True)
class Job:
    """One run of one task, in plain values.

    Attributes:
        overrides: What was given, without Hydra's own keys, such as ``model=haptic``.
        directory: The run folder, an absolute path.
        origin: Whether a command line runs it, a sweep with others, or a program in Python.
        named: Whether the run folder was given, not made up.
        searchpath: Further folders with configuration files, as ``file://DIR``.
        hydra: All of Hydra's own settings, for the record.
    """

    overrides: tuple[str, ...]
    directory: Path
    origin: Origin
    named: bool
    searchpath: tuple[str, ...]
    hydra: DictConfig

    def compose(self, overrides: Sequence[str]) -> DictConfig:
        """Compose another configuration from the same folders.

        Raises:
            HydraException: If an override is wrong.
        """
        return compose_config(CONF, overrides, self.searchpath)


def current_job(*, python: bool = False) -> Job:
    """The job that Hydra has just begun; nothing below asks Hydra again.

    Args:
        python: Whether a program in Python runs it.
    """
    hydra = HydraConfig.get()
    sources = hydra.runtime.config_sources
    return Job(
        overrides=tuple(hydra.overrides.task),
        directory=Path(hydra.runtime.output_dir).resolve(),
        origin="python" if python else "sweep" if hydra.mode == RunMode.MULTIRUN else "command",
        named=any(each.startswith(RUN_FOLDER) for each in hydra.overrides.hydra),
        searchpath=tuple(
            f"{each.schema}://{each.path}" for each in sources if each.provider in ASKED_FOR
        ),
        hydra=OmegaConf.create({"hydra": hydra}),
    )
