"""Every command of the documentation composes: no key, option or value in it is out of date."""

import re
import shlex
from pathlib import Path

import pytest
from hydra.core.override_parser.overrides_parser import OverridesParser

from tex_lightning.config import CONF
from tex_lightning.config.arguments import quote_files
from tex_lightning.config.check import check_known
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config

ROOT = CONF.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
START = "python -m tex_lightning"


def commands(page: Path) -> list[str]:
    """Arguments of this package in the blocks of a page, its own variables filled in."""
    text = page.read_text(encoding="utf-8")
    lines = [
        line.strip()
        for block in re.findall(r"^ *```bash\n(.*?)```", text, re.DOTALL | re.MULTILINE)
        for line in block.replace("\\\n", " ").splitlines()
    ]
    found = dict(line.split("=", 1) for line in lines if re.match(r"[A-Z]=\"", line))
    parts = [line.partition(START + " ")[2] for line in lines]
    filled = [_filled(part, found) for part in parts if part]
    return [part for part in filled if "--help" not in part and "--cfg" not in part]


def _filled(part: str, variables: dict[str, str]) -> str:
    for name, value in variables.items():
        part = part.replace(f"${name}", value.strip('"'))
    return re.split(r" [|;#<>] | && ", part)[0]


def first_choices(arguments: list[str]) -> list[str]:
    """Of a sweep the first job."""
    chosen = []
    for override in OverridesParser.create().parse_overrides(arguments):
        if override.is_hydra_override() or override.key_or_group.startswith("hydra"):
            continue
        if override.is_sweep_override():
            key = override.get_key_element()
            if override.is_choice_sweep():
                chosen.append(f"{key}={next(override.sweep_string_iterator())}")
        else:
            chosen.append(override.input_line)
    return chosen


CASES = [(page.name, command) for page in PAGES for command in commands(page)]


def test_there_are_many_commands():
    assert len(CASES) > 60


@pytest.mark.parametrize(("page", "command"), CASES)
def test_a_command_of_the_documentation_composes(page, command):
    arguments = [each for each in shlex.split(command) if each not in ("-m", "--multirun")]
    if "--config-dir" in arguments:  # a user's own parts, which tests/plugin runs
        return
    jobs = first_choices(quote_files(arguments))
    composed = compose_config(CONF, [*jobs, "crossval.share=null"])  # of a sweep: the job's folder
    check_known(composed)
    read_config(composed)
