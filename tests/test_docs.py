"""Every command of the documentation composes: no key, option or value in it is out of date."""

import re
import shlex
from pathlib import Path

import pytest
import torch
from hydra.core.override_parser.overrides_parser import OverridesParser
from hydra.utils import get_class

import tex_lightning as tl
from tex_lightning.config import CONF
from tex_lightning.config.arguments import quote_files
from tex_lightning.config.check import check_known
from tex_lightning.config.composition import compose_config
from tex_lightning.config.weights import read_config
from tex_lightning.features.spectrogram import SpectrogramFeatures
from tex_lightning.networks.tiles import layer_windows, receptive_field

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


ONCE = {command: page.name for page in PAGES for command in commands(page)}
CASES = [(page, command) for command, page in ONCE.items()]


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


def test_the_geometry_of_the_networks_is_that_of_the_code():
    page = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `(\w+)` \| (.+) \|$", page, re.MULTILINE)
    assert {name for name, _ in rows} == {path.stem for path in (CONF / "trunk").glob("*.yaml")}
    for name, cells in rows:
        visual = compose_config(CONF, ["model=visual", f"trunk={name}"]).model.visual
        with torch.device("meta"):  # nothing is computed
            trunk = get_class(visual.trunk._target_)(width=1.0, norm=visual.norm)
            network = tl.VisualNet(69, trunk, head=visual.head)
        places = "{} x {}".format(*network.output_size(1224, 1632))
        sizes = network.window_size[0], network.min_size[0], network.stride
        parameters = sum(each.numel() for each in network.parameters())
        facts = (*sizes, receptive_field(layer_windows(network, 1)), places, f"{parameters:,}")
        assert cells == " | ".join(map(str, facts)), name


def test_the_fragments_of_hapticnet_are_those_of_the_code():
    page = (ROOT / "docs" / "how_it_works.md").read_text(encoding="utf-8")
    network, features = tl.HapticNet(3, width=0.1), SpectrogramFeatures()
    seconds = [features.samples(frames) / 10_000 for frames in (192, 177)]
    assert (network.window_size[1], network.min_size[1]) == (192, 177)
    words = " ".join(page.split())
    assert f"192 frames ({seconds[0]:.2f} s, at least 177 frames or {seconds[1]:.2f} s)" in words
    assert f"sees {network.receptive_field} in a longer" in words
    found = network.output_size(50, features.frames(200_000))[1]
    assert f"20 s give {found} fragments" in words
