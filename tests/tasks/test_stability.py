"""``task=stability`` from the command line: its files, its protocol, what it refuses."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from drawing import DRAWN
from scipy.stats import binomtest

from tex_lightning.config.check import read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.studies.load_systems import load_systems

ONLY = ("white_noise", "shorter_trace", "jpeg")
COLUMNS = (
    "system modality perturbation severity test_samples vote_accuracy ci_low ci_high flip_rate"
)


def data(surfaces: Path) -> list[str]:
    return ["data=folder", f"data.root={surfaces}", "data.half_scale=false", "logger=csv"]


@pytest.fixture(scope="module")
def tested(run_once, surfaces, fused, crossvalidated) -> Path:
    systems = f"{fused},{crossvalidated},{fused}/checkpoints/haptic.ckpt"
    DRAWN.clear()  # its figures are looked at
    return run_once(
        "task=stability", f"stability.systems=[{systems}]", f"stability.only=[{','.join(ONLY)}]",
        *data(surfaces),
    )  # fmt: skip


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.fixture(scope="module")
def lines(tested) -> list[dict[str, str]]:
    return table(tested / "stability.csv")


def test_the_table_has_every_trial_with_its_interval(lines):
    assert list(lines[0]) == [*COLUMNS.split(), "lost", "gained"]
    systems = {line["system"] for line in lines}
    assert systems == {"fusion", "visual", "haptic (1)", "haptic (2)", "haptic (3)"}
    for name in ONLY:
        rows = [line for line in lines if line["perturbation"] == name]
        for system in {line["system"] for line in rows}:
            severities = [line["severity"] for line in rows if line["system"] == system]
            assert severities == ["0", "1", "2", "3", "4", "5"]
    for line in lines:
        count, share = int(line["test_samples"]), float(line["vote_accuracy"])
        interval = binomtest(round(share * count), count).proportion_ci(method="wilson")
        assert float(line["ci_low"]) == pytest.approx(interval.low)
        assert float(line["ci_high"]) == pytest.approx(interval.high)
        if line["severity"] == "0":
            assert float(line["flip_rate"]) == 0
    assert {line["perturbation"] for line in lines if line["system"] == "visual"} == {"jpeg"}


def test_results_and_figures_are_there(tested, lines):
    results = json.loads((tested / "results.json").read_text())
    assert set(results["perturbations"]) == set(ONLY)
    errors = [
        1 - float(line["vote_accuracy"])
        for line in lines
        if line["system"] == "fusion" and line["severity"] != "0"
    ]
    assert results["systems"]["fusion"]["mean_error"] == pytest.approx(np.mean(errors))
    assert (tested / "figures" / "stability.png").stat().st_size > 5000


def test_what_fails_first_is_in_results_and_page_with_readable_names(tested, lines):
    results = json.loads((tested / "results.json").read_text())
    pairs = {(line["system"], line["perturbation"]) for line in lines}
    assert {(each["system"], each["perturbation"]) for each in results["failures"]} == pairs
    for each in results["failures"]:
        clean, *rows = [
            line
            for line in lines
            if (line["system"], line["perturbation"]) == (each["system"], each["perturbation"])
        ]
        shares = [float(row["vote_accuracy"]) for row in rows]
        broken = [n for n, x in enumerate(shares, 1) if x < float(clean["vote_accuracy"]) / 2]
        found = each["broken_from"] and each["broken_from"]["severity"]
        assert found == (broken[0] if broken else None)
        for row, share in zip(rows, shares, strict=True):
            change = (float(clean["vote_accuracy"]) - share) * int(row["test_samples"])
            assert int(row["lost"]) - int(row["gained"]) == pytest.approx(change)
    page = (tested / "report.html").read_text()
    assert "What fails first" in page
    assert page.count("<td>stroke velocity</td>") == 0
    assert page.count("<td>shorter_trace</td>") == sum(
        line["perturbation"] == "shorter_trace" for line in lines
    )  # the whole of stability.csv
    for label in ("FusionNet-FC2", "visual inside fusion", "checkpoints/haptic.ckpt)"):
        assert f"{label}</td>" in page


def test_folds_of_a_cross_validation_are_its_own_whatever_the_division(surfaces, crossvalidated):
    asked = ["task=stability", f"stability.systems=[{crossvalidated}]", "data.folds=5"]
    config = read_config(compose_config([*asked, *data(surfaces)]))
    (system,) = load_systems(config)
    told = json.loads((crossvalidated / "results.json").read_text())["networks"]["haptic"]
    right = [label == truth for label, truth in zip(system.clean, system.labels, strict=True)]
    assert (sum(right), len(right)) == (told["correct"], told["test_samples"])


def test_mistakes_end_in_one_sentence(cli, surfaces, fused, crossvalidated, tmp_path):
    common = ["task=stability", *data(surfaces), f"hydra.run.dir={tmp_path}/run"]

    def refuse(message, *arguments):
        outcome = cli(*common, *arguments)
        assert outcome.status == 2, outcome.err
        assert message in outcome.err

    refuse("task=stability needs one")
    refuse("holds no finished checkpoint", f"stability.systems=[{tmp_path}]")
    refuse("has trained on 6 of the 6 test", f"stability.systems=[{fused}]", "data.test_fold=4")
    systems = f"stability.systems=[{crossvalidated}]"
    refuse("(did you mean white_noise?)", systems, "stability.only=[white_nose]")
    entry = "{function: numpy.multiply, unit: x, levels: [0, 1, 2, 3, 4, 5]}"
    (tmp_path / "own.yaml").write_text(f"hapitc: {{mine: {entry}}}\n")
    severities = f"stability.severities=[{tmp_path}/own.yaml]"
    refuse("has the modality hapitc (did you mean haptic?)", systems, severities)
