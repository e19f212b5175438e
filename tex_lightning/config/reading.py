"""Which keys a composed task reads for its model."""

from typing import Any

from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import Config, flatten
from tex_lightning.config.check_nodes import known_keys
from tex_lightning.config.instantiation import TARGET
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
    own: dict[str, Key] = {}
    for sense in model.senses if not every and "model" in READS[task] else ():
        if sense not in PACKAGE_SENSES and OmegaConf.is_dict(model.get(sense)):
            own |= _own_keys(f"model.{sense}", model[sense])
    return own | {
        name: key
        for name, key in walk(Config)
        if f"{name}.".startswith(read)
        and not name.startswith(unused)
        and (trains or ".fit." not in name)
    }


def _own_keys(where: str, node: DictConfig) -> dict[str, Key]:
    """Keys of a user's sense: with the schema's meaning, or as arguments of its classes."""
    values: Any = OmegaConf.to_container(node, resolve=False)
    unknown = Key("of a class of this sense")
    keys = {}
    for name in flatten(values):
        leaf = name.rpartition(".")[2]
        if not leaf.startswith("_") or leaf == TARGET:
            named = Key("class, and its arguments beside it") if leaf == TARGET else unknown
            ours = name.startswith(("fit.", "decode.")) or "." not in name
            known = known_keys().get(leaf, ()) if ours else ()
            keys[f"{where}.{name}"] = known[0][0] if known else named
    return keys
