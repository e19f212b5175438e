"""The texts of ``--help`` and ``--version``: the commands, and the keys that a task reads."""

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path

from omegaconf import DictConfig, OmegaConf

from tex_lightning import __version__
from tex_lightning.config import READS, Config
from tex_lightning.config.composition import compose_config, keys_read
from tex_lightning.config.keys import Key, plain, walk
from tex_lightning.config.mistakes import config_groups, unknown_option

WIDTH = 79
ALL = "all"
FLAGS = ("-h", "--help", "--version")
TOPIC = ("help=", "--help=")
PARTS = {"sense": "model", "trunk": "model"}  # groups that fill in a section of another name
EVERYWHERE = ("task", "experiment", "debug")  # groups that go with any task

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
  task=NAME --help   keys that a task reads: meaning, range, value
  --help=all         all groups with their options, and all keys
  --cfg job          the configuration that a command line composes
  --hydra-help       flags of Hydra; --version is that of tex_lightning
Results land in hydra.run.dir: results.json, checkpoints, figures, metrics.csv
and TensorBoard events. README.md leads to the chapters in docs/."""


def asks(arguments: Sequence[str]) -> bool:
    """Whether a command line asks for help or the version in place of a run."""
    return any(item in FLAGS or item.startswith(TOPIC) for item in arguments)


def answer(arguments: Sequence[str], conf: Path) -> str:
    """The text that a command line asks for.

    Args:
        arguments: The command line after the program's name.
        conf: Folder of the configuration files.

    Raises:
        UserError: If there is no help under the name asked for.
        HydraException: If an override beside it is wrong.
    """
    if "--version" in arguments:
        return f"tex_lightning {__version__}"
    topics = [item.partition("=")[2] for item in arguments if item.startswith(TOPIC)]
    overrides = [item for item in arguments if "=" in item and not item.startswith(("-", *TOPIC))]
    tasks = [item.partition("=")[2] for item in overrides if item.startswith("task=")]
    if not topics and not tasks:
        return COMMANDS.format(tasks="\n".join(_tasks(conf)))
    topic = (topics or tasks)[-1]
    if topic not in (*READS, ALL):
        raise unknown_option("help", topic, (*READS, ALL))
    if topic == ALL:
        return _listing(compose_config(conf, overrides), conf, dict(walk(Config)))
    config = compose_config(conf, [*overrides, f"task={topic}"])
    return _listing(config, conf, keys_read(config))


def _tasks(conf: Path) -> Iterator[str]:
    """A line for each task: the first sentence of the comment in its file."""
    for task in READS:
        text = (conf / "task" / f"{task}.yaml").read_text(encoding="utf-8")
        comments = [line[2:] for line in text.splitlines() if line.startswith("# ")]
        said = " ".join(line for line in comments if not line.startswith("@"))
        yield f"  {task:<11}{said.partition('. ')[0].rstrip('.')}"


def _listing(config: DictConfig, conf: Path, keys: dict[str, Key]) -> str:
    """Groups and keys with their values, sections apart."""
    sections = {name.partition(".")[0] for name in keys} | {*EVERYWHERE}
    lines = ["Groups and their options (group=option):", ""]
    for group, options in config_groups(conf).items():
        root, _, rest = PARTS.get(group, group).partition("/")
        if root in sections and (root != "experiment" or not rest):
            lines += _wrapped(" | ".join(options), f"  {group}=", "      ")
    lines += ["", "Keys and their values (change any by key=value):"]
    before = None
    for name, key in keys.items():
        section = name.rpartition(".")[0]
        lines += [""] * (section != before)
        before = section
        line = f"{name}={_value(config, name)}"
        lines.append(line if len(line) <= WIDTH else f"{line[: WIDTH - 4]} ...")
        lines += _wrapped(key.meaning + _limits(key), "    ", "    ")
    return "\n".join(lines)


def _wrapped(text: str, first: str, others: str) -> list[str]:
    return textwrap.wrap(text, WIDTH, initial_indent=first, subsequent_indent=others)


def _limits(key: Key) -> str:
    said = [key.unit, " | ".join(map(str, key.choices)), key.range]
    known = ", ".join(item for item in said if item)
    return f" [{known}]" if known else ""


def _value(config: DictConfig, name: str) -> str:
    """A value as typed on the command line."""
    section, _, leaf = name.rpartition(".")
    node = OmegaConf.select(config, section) if section else config
    if OmegaConf.is_missing(node, leaf):
        return "???"
    return _typed(OmegaConf.to_container(node, resolve=False)[leaf])  # type: ignore[index,call-overload]


def _typed(value: object) -> str:
    if isinstance(value, list):
        return f"[{','.join(map(_typed, value))}]"
    if isinstance(value, dict):
        return f"{{{','.join(f'{name}: {_typed(item)}' for name, item in value.items())}}}"
    words = {None: "null", True: "true", False: "false"}
    named = value is None or isinstance(value, bool)
    return words[value] if named else plain(value)  # type: ignore[index]
