"""Every command of the documentation composes: no key, option or value in it is out of date."""

import re
import runpy
from typing import Any

import pytest
import torch
from documentation import MULTIRUN, PAGES, ROOT, START, commands, package_arguments, sweep_jobs
from hydra.utils import get_class
from scipy.stats import binomtest

import tex_lightning as tl
from tex_lightning.config import CONF
from tex_lightning.config.check import check_known
from tex_lightning.config.composition import compose_config, quote_files
from tex_lightning.config.weights import read_config
from tex_lightning.networks.geometry import layer_windows, receptive_field
from tex_lightning.report.table import paper_table
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures

FOUND = {
    command: block.page
    for page in PAGES
    for block, command in commands(page)
    if START in command and not re.search(r"--(help|cfg)\b", command)
}
CASES = [(page, command) for command, page in FOUND.items()]


def test_there_are_many_commands():
    assert len(CASES) > 60


@pytest.mark.parametrize(("page", "command"), CASES)
def test_a_command_of_the_documentation_composes(page, command):
    arguments = [each for each in package_arguments(command) if each not in MULTIRUN]
    if "--config-dir" in arguments:  # a user's own parts, which tests/plugin runs
        return
    jobs = sweep_jobs(quote_files(arguments))
    composed = compose_config(CONF, jobs)
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


def script(name: str) -> dict[str, Any]:
    """What a script of the documentation defines."""
    return runpy.run_path(str(ROOT / "docs" / f"{name}.py"))


def test_drawings_and_tables_of_layers_are_those_of_the_code():
    made = script("draw_networks")["made_files"]()
    assert {path.name for path in made} >= {"hapticnet.md", "hapticnet.svg", "fusionnet.svg"}
    assert [path.name for path, text in made.items() if path.read_text("utf-8") != text] == []
    pages = [path for path in made if path.suffix == ".md"]
    pattern = r"<!-- made by .+? -->\n\n(\|.+\|\n){3,}\n<!-- end -->"
    assert len(pages) >= 5
    assert [page.name for page in pages if not re.search(pattern, page.read_text("utf-8"))] == []


def test_layers_add_up_to_what_was_counted_by_hand():
    made = script("draw_networks")
    sums = {}
    for name, (network, size) in made["networks"]().items():
        rows = made["layers"](network, size)
        sums[name] = sum(row.parameters for row in rows), sum(row.macs for row in rows)
    conv = [(3, 3, 1, 50, 50 * 192), (3, 3, 50, 100, 25 * 96), (3, 3, 100, 150, 13 * 48)]
    conv += [(3, 3, 150, 200, 7 * 24), (4, 12, 200, 400, 1), (1, 1, 400, 250, 1)]
    conv += [(1, 1, 250, 69, 1)]
    macs = sum(h * w * inputs * outputs * places for h, w, inputs, outputs, places in conv)
    parameters = sum((h * w * inputs + 1) * outputs for h, w, inputs, outputs, _ in conv)
    assert sums["hapticnet"] == (parameters, macs)
    assert sums["visualnet"][0] == 5_191_749  # Caffe's AlexNet to pool5, then 300, 250, 69


COUNTED = re.compile(
    r"([\d.]+) % \((\d+)/(\d+)\)(?:\*\*)? \| ([\d.]+) to ([\d.]+) %"
)  # share, counts and interval of a row


def test_shares_and_intervals_are_those_of_their_counts():
    rows = [row for page in PAGES for row in COUNTED.findall(page.read_text("utf-8"))]
    assert len(rows) > 40
    for row in rows:
        correct, count = int(row[1]), int(row[2])
        interval = binomtest(correct, count).proportion_ci(0.95, "wilson")
        figures = (correct / count, interval.low, interval.high)
        written = (row[0], row[3], row[4])
        assert [f"{100 * each:.1f}" for each in figures] == [f"{float(w):.1f}" for w in written]


def test_every_figure_of_the_readme_is_one_of_the_results():
    readme, results = (
        {row[1:3] for row in COUNTED.findall((ROOT / name).read_text("utf-8"))}
        for name in ("README.md", "docs/results.md")
    )
    assert len(readme) >= 5
    assert readme <= results


def test_the_rows_of_the_paper_are_its_figures_and_presets():
    rows = [row for name in ("haptic", "visual", "fusion") for row in paper_table(name)["rows"]]
    published = {
        row["label"]: [f"{row[key]:g} %" if key in row else "" for key in ("fragment", "vote")]
        for row in rows
        if {"fragment", "vote"} & {*row}
    }
    text = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
    found = re.findall(r"^\| (.+?) \| (.*?) ?\| (.*?) ?\| `(\w+=.+)` \|$", text, re.MULTILINE)
    assert {label: [fragment, vote] for label, fragment, vote, _ in found} == published
    for label, *_, overrides in found:
        config = read_config(compose_config(CONF, overrides.split()))
        (row,) = [row for row in rows if row["label"] == label]
        assert config.model.name == row["model"], label
