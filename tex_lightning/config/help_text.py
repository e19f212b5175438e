"""The texts of ``--help`` and ``--version``."""

import textwrap
from collections.abc import Iterator, Sequence
from typing import Any

from omegaconf import DictConfig, OmegaConf

from tex_lightning import __version__
from tex_lightning.config import CONF, TASKS, Config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.keys import typed
from tex_lightning.config.nodes import walk
from tex_lightning.config.user_folders import config_groups

WIDTH = 79
ALL = "--help=all"
FLAGS = ("-h", "--help", "--version", ALL)

COMMANDS = """\
tex_lightning: which material is it? It classifies surfaces from a tool's
acceleration trace and a photo, with HapticNet, VisualNet and FusionNet.

Usage: python -m tex_lightning [task=NAME] [group=option] [key=value]

Train all three networks on built-in synthetic surfaces:
  python -m tex_lightning model=fusion
Train on your own recordings, DIR/CLASS/haptic/*.wav and DIR/CLASS/image/*.jpg:
  python -m tex_lightning model=fusion data=folder data.root=DIR
Test every fold once; the same command goes on where it was stopped:
  python -m tex_lightning task=crossval model=haptic hydra.run.dir=RUN
Classify files with a trained network:
  python -m tex_lightning task=predict checkpoint=FILE haptic=A.wav image=B.jpg
Run several seeds in one sweep:
  python -m tex_lightning -m model=haptic,visual seed=0,1,2
Try any of this in seconds:
  python -m tex_lightning model=fusion debug=tiny

Tasks:
{tasks}

More to read:
  --help=all         all groups and all keys: meaning, range, value now
  --cfg job          the configuration that a command line composes
  --hydra-help       flags of Hydra; --version is that of tex_lightning
Results land in hydra.run.dir. README.md leads to the pages in docs/."""


def requested_help(arguments: Sequence[str]) -> str:
    """Return the text that a command line asks for in place of a run; empty if for none.

    Raises:
        HydraException: If an override is wrong.
    """
    if not any(item in FLAGS for item in arguments):
        return ""
    if "--version" in arguments:
        return f"tex_lightning {__version__}"
    overrides = [item for item in arguments if "=" in item and not item.startswith("-")]
    if not any(item.startswith((ALL, "task=")) for item in arguments):
        return COMMANDS.format(tasks="\n".join(_tasks()))
    return _listing(compose_config(overrides))


def _tasks() -> Iterator[str]:
    """Yield a line for each task: the first sentence of the comment in its file."""
    for task in TASKS:
        text = (CONF / "task" / f"{task}.yaml").read_text(encoding="utf-8")
        comments = [line[2:] for line in text.splitlines() if line.startswith("# ")]
        said = " ".join(line for line in comments if not line.startswith("@"))
        yield f"  {task:<11}{said.partition('. ')[0].rstrip('.')}"


def _listing(config: DictConfig) -> str:
    """Return groups and keys with their values, sections apart."""
    lines = ["Groups and their options (group=option):", ""]
    for group, options in config_groups().items():
        lines += _wrapped(" | ".join(options), f"  {group}=", "      ")
    lines += ["", "Keys and their values (change any by key=value):"]
    values: Any = OmegaConf.to_container(config, resolve=False)
    before = None
    for name, key in walk(Config, values):
        section = name.rpartition(".")[0]
        lines += [""] * (section != before)
        before = section
        lines.append(textwrap.shorten(f"{name}={typed(values, name)}", WIDTH, placeholder=" ..."))
        allowed = " ".join(filter(None, [" | ".join(map(str, key.choices)), key.range, key.unit]))
        lines += _wrapped(": ".join(filter(None, [key.meaning, allowed])), "    ", "    ")
    return "\n".join(lines)


def _wrapped(text: str, first: str, others: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=first, subsequent_indent=others)
