"""Learning curves of a sweep over the recordings of a class, through the real command line."""

import csv

import pytest
from PIL import Image

from tex_lightning.report.figures import LearningPoint
from tex_lightning.report.systems import read_systems


@pytest.fixture(scope="module")
def swept(surfaces, run_once):
    return run_once(
        "-m", "hydra.sweep.dir=${hydra.run.dir}", "model=mfcc_nb", "task=crossval",
        "data=folder", f"data.root={surfaces}",
        "data.per_class=1,3", "crossval.only=[0,1,2]",
    )  # fmt: skip


def test_each_count_of_recordings_is_a_point_with_its_interval(swept):
    with (swept / "learning_curve.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [(row["system"], row["per_class"]) for row in rows] == [
        ("mfcc_nb", "1"),
        ("mfcc_nb", "3"),
    ]
    assert all(row["test_samples"] == "9" for row in rows)
    point = LearningPoint(int(rows[0]["per_class"]), int(rows[0]["correct"]), 9)
    assert float(rows[0]["vote_accuracy"]) == point.accuracy
    assert float(rows[0]["ci_low"]) == pytest.approx(point.interval[0])


def test_the_chart_stands_in_the_report(swept):
    assert "figures/learning_curve.png" in (swept / "report.md").read_text()
    with Image.open(swept / "figures" / "learning_curve.png") as image:
        assert image.width > 500


def test_runs_of_several_counts_are_systems_apart(swept):
    systems = read_systems([swept / "0", swept / "1"])
    assert len(systems) == 2
    assert {len(system.outcomes) for system in systems} == {9}
