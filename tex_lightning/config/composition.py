"""Compose this package's configuration and run a job with it, wherever Hydra is at the time."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from hydra import compose, initialize_config_dir
from hydra._internal.callbacks import Callbacks
from hydra.core.global_hydra import GlobalHydra
from hydra.core.utils import JobRuntime, run_job
from hydra.types import HydraContext, RunMode
from hydra.version import VersionBase
from omegaconf import DictConfig

from tex_lightning.config import CONF, register
from tex_lightning.config.search import with_own_senses
from tex_lightning.errors import UserError

NAME = "config"


def compose_config(
    conf: Path, overrides: Sequence[str] = (), searchpath: Sequence[str] = ()
) -> DictConfig:
    """The configuration as a command line composes it.

    Args:
        conf: Folder of the configuration files.
        overrides: Such as ``model=haptic``.
        searchpath: Further folders with configuration files, as ``file://DIR``.

    Raises:
        HydraException: If an override is wrong.
    """
    folders = ",".join('"{}"'.format(folder.replace('"', '\\"')) for folder in searchpath)
    more = [f"hydra.searchpath=[{folders}]"] if searchpath else []
    with _hydra(conf):
        return compose(NAME, overrides=[*with_own_senses(overrides), *more])


def run_composed(function: Callable[[DictConfig], Any], overrides: Sequence[str]) -> Any:  # noqa: ANN401
    """Call a function as Hydra's command line would, in a run folder, and return what it returns.

    Logging and the working directory stay the caller's.

    Raises:
        UserError: If the overrides ask for a sweep.
        Exception: What the function raises, or Hydra of a wrong override.
    """
    raised: list[Exception] = []

    def guarded(composed: DictConfig) -> Any:  # noqa: ANN401
        try:
            return function(composed)
        except Exception as error:  # Hydra would print a line of its own
            raised.append(error)

    with _hydra(CONF):
        config = compose(NAME, overrides=with_own_senses(overrides), return_hydra_config=True)
        if config.hydra.mode == RunMode.MULTIRUN:
            raise UserError(
                "These overrides ask for a sweep; run it by python -m tex_lightning, or call this "
                "once for each job."
            )
        context = HydraContext(GlobalHydra.instance().config_loader(), Callbacks(config))
        finished = run_job(guarded, config, "hydra.run.dir", None, context, False)
    if raised:
        raise raised[0]
    return finished.return_value


@contextmanager
def _hydra(conf: Path) -> Iterator[None]:
    """Initialise Hydra for this package; afterwards it is as the caller's application left it."""
    register()
    running, base = GlobalHydra.instance().hydra, VersionBase.instance().version_base
    GlobalHydra.instance().clear()
    try:
        with initialize_config_dir(str(conf), JobRuntime.instance().get("name"), "1.3"):
            yield
    finally:
        GlobalHydra.instance().hydra = running
        VersionBase.instance().version_base = base
