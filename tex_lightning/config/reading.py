"""Which keys a composed task reads for its model."""

from omegaconf import DictConfig

from tex_lightning.config import Config
from tex_lightning.config.keys import Key, walk
from tex_lightning.config.model import FUSION, PACKAGE_SENSES
from tex_lightning.config.tasks import READS

EVERYWHERE = ("task", "verbose")  # every task reads these


def keys_read(config: DictConfig) -> dict[str, Key]:
    """Metadata of the keys that ``config.task`` reads for ``config.model``, by dotted name."""
    task, model = config.task, config.model
    every = task == "frontier" or model.name == "auto"
    used = (*PACKAGE_SENSES, FUSION) if every else () if model.baseline else (*model.senses,)
    used += (FUSION,) if len(used) > 1 else ()
    unused = tuple(f"model.{name}." for name in (*PACKAGE_SENSES, FUSION) if name not in used)
    read = tuple(f"{part}." for part in (*EVERYWHERE, *READS[task]))
    trains = "trainer" in READS[task]
    return {
        name: key
        for name, key in walk(Config)
        if f"{name}.".startswith(read)
        and not name.startswith(unused)
        and (trains or ".fit." not in name)
    }
