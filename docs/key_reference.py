"""The tables of all configuration keys, made from the schema: ``python docs/key_reference.py``."""

import json
import textwrap

from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import Config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.keys import Key, plain, walk
from tex_lightning.report.table import markdown

HEADINGS = ("key", "meaning", "choices or range, unit", "default")
WIDTH = 60  # of a default
MODELS = ("fusion", "sound")  # whose sections the default configuration leaves out


def reference() -> str:
    """Return a heading and a table in Markdown for each section of the configuration."""
    configs = [compose_config([]), *(compose_config([f"model={m}"]) for m in MODELS)]
    sections: dict[str, list[list[str]]] = {}
    for name, key in walk(Config):
        section = name.rpartition(".")[0]
        sections.setdefault(section, []).append(_row(name, key, configs))
    return "\n\n".join(
        "\n".join([f"## {section or 'General'}", "", *markdown(HEADINGS, rows)])
        for section, rows in sections.items()
    )


def _row(name: str, key: Key, configs: list[DictConfig]) -> list[str]:
    choices = ", ".join(f"`{choice}`" for choice in key.choices)
    limits = " ".join(filter(None, [choices, key.range, key.unit]))
    default = next(filter(None, (_default(config, name) for config in configs)), "")
    return [f"`{name}`", key.meaning, limits, f"`{default}`" if default else ""]


def _default(config: DictConfig, name: str) -> str:
    """Format a value as it is typed on the command line; "" where the configuration has none."""
    section, _, leaf = name.rpartition(".")
    node = OmegaConf.select(config, section) if section else config
    if node is None or leaf not in node:
        return "???" if node is not None and OmegaConf.is_missing(node, leaf) else ""
    value = OmegaConf.to_container(node, resolve=False)[leaf]
    text = plain(value) if isinstance(value, str | float) else json.dumps(value).replace('"', "")
    return textwrap.shorten(text, WIDTH, placeholder=" …")


if __name__ == "__main__":
    print(reference())
