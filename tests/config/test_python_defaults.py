"""A value that stands in the configuration and in Python is the same in both."""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import yaml
from omegaconf import MISSING, OmegaConf

from tex_lightning.config import CONF, Config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.instantiation import PACKAGE, find_class
from tex_lightning.config.keys import Key, hints_of
from tex_lightning.config.nodes import is_node
from tex_lightning.config.signatures import TARGET, signature_of
from tex_lightning.config.user_folders import LOADER

ABSENT = (None, (), MISSING)  # defaults that are no values
# A checkpoint without the key is rebuilt by the default, which is that of every trunk
KEPT = {("EfficientNetLite0", "patch"), ("EfficientNetLite2", "patch")}
Found = tuple[tuple[str, str], Any, Any]  # class and key, default, value


def in_nodes(values: Any, outer: dict[str, Any]) -> Iterator[Found]:
    """Yield what a file gives to classes, with the keys of the sense around them."""
    if is_node(values) and values[TARGET].startswith(PACKAGE):
        cls, given = find_class("x", values), {**outer, **values}
        for name, parameter in signature_of(cls).parameters.items():
            if name in given and Key.of(parameter.annotation).meaning:
                yield (cls.__name__, name), parameter.default, given[name]
    for item in values.values() if isinstance(values, dict) else ():
        yield from in_nodes(item, values)


def in_sections(section: type, values: dict[str, Any]) -> Iterator[Found]:
    """Yield what is composed by default of the fields of a section."""
    for part in fields(section):
        if is_dataclass(kind := hints_of(section)[part.name]):
            yield from in_sections(kind, values[part.name])
        else:
            yield (section.__name__, part.name), part.default, values[part.name]


def test_a_default_of_python_is_a_value_of_the_configuration():
    composed = OmegaConf.to_container(compose_config(), resolve=False)
    found = [*in_sections(Config, composed)]
    for path in CONF.rglob("*.yaml"):
        found += in_nodes(yaml.load(path.read_text(encoding="utf-8"), LOADER), {})
    given = defaultdict(list)
    for key, default, value in found:
        if default not in ABSENT and isinstance(default, bool | int | float | str | tuple):
            given[key, default].append(tuple(value) if isinstance(value, list) else value)
    assert len(given) > 10
    assert {key for (key, default), values in given.items() if default not in values} == KEPT
