"""Tables and figures of a sweep, from rows to report, through the command line."""

import csv
import re

import pytest
from PIL import Image

from tex_lightning.report.document import read_systems


@pytest.fixture(scope="module")
def swept(run_once, surfaces):
    """A small table: one baseline, one network and one FusionNet, one fold."""
    directory = run_once(
        "experiment=paper/all", "debug=tiny", "data=folder", f"data.root={surfaces}",
        "data.half_scale=false", "crossval.only=[0]",
        "model.visual.width=0.1",
        "hydra.sweep.dir=${hydra.run.dir}",
        "hydra.sweeper.params.model='haptic,fusion,mfcc_nb'",
    )  # fmt: skip
    return directory


def test_report_holds_every_row_with_counts(swept):
    report = (swept / "report.md").read_text()
    for label in ("HapticNet", "FusionNet-FC2", "Modified MFCC decreasing"):
        row = next(line for line in report.splitlines() if line.startswith(f"| {label}"))
        assert re.search(r"\(\d/3\)", row)


def test_figures_named_in_the_report_are_images(swept):
    names = re.findall(r"\]\((figures/[^)]+)\)", (swept / "report.md").read_text())
    assert len(names) == len({*names})
    for name in names:
        with Image.open(swept / name) as image:
            assert min(image.size) > 100


def test_rows_of_one_network_have_the_same_votes(swept):
    systems = read_systems([swept / str(job) for job in range(2)])
    own = next(item for item in systems if item.model == "haptic" and not item.inside)
    inside = [item for item in systems if item.model == "haptic" and item.inside]
    assert len(inside) == 1
    for system in inside:
        assert system.outcomes[0].votes == own.outcomes[0].votes


def test_sweep_lists_all_jobs(swept):
    with (swept / "sweep.csv").open() as stream:
        assert {line["job"] for line in csv.DictReader(stream)} == {"0", "1", "2"}
