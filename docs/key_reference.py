"""The tables of all configuration keys, made from the schema: ``python docs/key_reference.py``."""

import textwrap
from typing import Any

from omegaconf import OmegaConf

from tex_lightning.config import Config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.keys import Key, typed
from tex_lightning.config.nodes import walk
from tex_lightning.report.table import markdown

HEADINGS = ("key", "meaning", "choices or range, unit", "default")
WIDTH = 60  # of a default
MODELS = (
    "fusion",
    "sound",
    "band_proportions",
)  # whose sections the default configuration leaves out


def reference() -> str:
    """Return a heading and a table in Markdown for each section of the configuration."""
    composed = [compose_config(), *(compose_config([f"model={name}"]) for name in MODELS)]
    configs: list[Any] = [OmegaConf.to_container(config, resolve=False) for config in composed]
    keys = {name: key for config in configs for name, key in walk(Config, config)}
    sections: dict[str, list[list[str]]] = {}
    for name, key in keys.items():
        section = name.rpartition(".")[0]
        sections.setdefault(section, []).append(_row(name, key, configs))
    return "\n\n".join(
        "\n".join([f"## {section or 'General'}", "", *markdown(HEADINGS, rows)])
        for section, rows in sections.items()
    )


def _row(name: str, key: Key, configs: list[Any]) -> list[str]:
    choices = ", ".join(f"`{choice}`" for choice in key.choices)
    limits = " ".join(filter(None, [choices, key.range, key.unit]))
    default = next(filter(None, (typed(config, name) for config in configs)), "")
    default = textwrap.shorten(default, WIDTH, placeholder=" …")
    return [f"`{name}`", key.meaning, limits, f"`{default}`" if default else ""]


if __name__ == "__main__":
    print(reference())
