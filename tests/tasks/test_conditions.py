"""Conditions that are tested and never trained on, through every task that meets them."""

import json
import math
import re
from pathlib import Path

import pytest
from conftest import CLASSES, FEW

import tex_lightning as tl
from tex_lightning.data.store import fingerprint
from tex_lightning.evaluation.outcomes import read_outcomes

SPEEDS = ["40", "50", "60.0", "40", "50", "60", "40", "50", "60", "40"]  # of stroke 0 to 9
FAST = "data.test_where={speed: 60}"
FUSED = (
    "experiment=few/fusion", "weights=null", "trunk=tcnn", "model.visual.norm=batch",
    "model.visual.head=[30,25]", "model.visual.width=0.1", "debug=tiny", "logger=csv", *FEW[1:],
)  # fmt: skip
HAPTIC = (*FEW, "logger=csv")


@pytest.fixture(scope="module")
def manifest(surfaces, tmp_path_factory) -> Path:
    """The traces of every class at three speeds, and its photos, which have none."""
    lines = ["label,modality,path,group,speed,light"]
    for label in CLASSES:
        for n, speed in enumerate(SPEEDS):
            lines.append(f"{label},haptic,{surfaces}/{label}/haptic/{label}_{n}.wav,{n},{speed},")
            lines.append(f"{label},image,{surfaces}/{label}/image/{label}_{n}.png,{n},,lamp")
    path = tmp_path_factory.mktemp("conditions") / "m.csv"
    path.write_text("\n".join(lines) + "\n")
    return path


def given(manifest: Path, directory: Path | None = None) -> list[str]:
    data = ["data=manifest", f"data.manifest={manifest}", "data.half_scale=false"]
    return data + ([] if directory is None else [f"hydra.run.dir={directory}"])


@pytest.fixture(scope="module")
def fused(run_once, manifest) -> Path:
    """FusionNet and its parts, trained without the fastest strokes."""
    return run_once(*FUSED, FAST, *given(manifest))


def results(run: Path) -> dict:
    return json.loads((run / "results.json").read_text())


def files_tested(run: Path, kind: str, modality: str) -> set[str]:
    outcomes = read_outcomes(run / "predictions" / f"{kind}.csv")
    return {Path(outcome.files[modality]).stem for outcome in outcomes}


def test_the_fast_strokes_are_tested_and_nothing_has_seen_them(fused, surfaces):
    fast = {f"{label}_{n}" for label in CLASSES for n in (2, 5, 8)}
    first = {f"{label}_0" for label in CLASSES}
    tests = {"haptic": {"haptic": fast}, "visual": {"image": first}}
    tests["fusion"] = tests["haptic"] | tests["visual"]
    for kind, tested in tests.items():
        seen = set(tl.load(fused / "checkpoints" / f"{kind}.ckpt").card.trained_on["seen"])
        for modality, names in tested.items():
            assert files_tested(fused, kind, modality) == names
        files = [file for name in tested for file in surfaces.glob(f"*/{name}/*")]
        trained = [file for file in files if file.stem not in tested[file.parent.name]]
        assert seen == {fingerprint(file) for file in trained}


def test_a_run_is_named_by_what_it_tests(fused, crossvalidated):
    for run, tested in ((fused, "The part with speed 60"), (crossvalidated, "Fold 3")):
        log = (run / "tex_lightning.log").read_text()
        assert re.search(rf"{tested}, haptic network: \d+ of \d+ samples correct", log)
        assert ("Fold" in log) == tested.startswith("Fold")


def test_folds_pool_their_votes_by_condition(cli, manifest, tmp_path):
    outcome = cli(*HAPTIC, "task=crossval", "crossval.only=[0,1]", *given(manifest, tmp_path))
    assert outcome.status == 0, outcome.err
    outcomes = read_outcomes(tmp_path / "predictions/haptic.csv")
    entry = results(tmp_path)["networks"]["haptic"]["conditions"]["speed"]
    for value, counts in entry.items():
        own = [
            each
            for each in outcomes
            if math.isclose(float(SPEEDS[int(each.files["haptic"][-5])]), float(value))
        ]
        right = sum(each.label == each.predicted for each in own)
        assert (counts["correct"], counts["test_samples"]) == (right, len(own)) != (0, 0)
    assert "| speed | 40 | 100.0% (3/3) |" in (tmp_path / "report.md").read_text()


def test_a_checkpoint_is_tested_on_the_same_conditions_or_not_at_all(
    cli, fused, manifest, tmp_path
):
    task = "task=evaluate", f"checkpoint={fused}/checkpoints/haptic.ckpt"
    same = cli(*task, FAST, *given(manifest, tmp_path / "same"))
    assert same.status == 0, same.err
    before = results(fused)["networks"]["haptic"]
    after = results(tmp_path / "same")["networks"]["haptic"]
    assert after["test_samples"] == before["test_samples"] == 9
    assert after["conditions"] == before["conditions"]
    assert cli(*task, *given(manifest, tmp_path / "alike")).status == 0
    assert results(tmp_path / "alike")["networks"]["haptic"]["conditions"] == before["conditions"]
    other = cli(*task, "data.test_fold=0", *given(manifest, tmp_path / "other"))
    assert other.status == 2
    assert f"data.test_fold=0 '{FAST}' as in its training" in other.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["data.test_where={sped: 60}"],
            "no recording has sped 60 (did you mean speed?); choose from speed",
        ),
        (["data.test_where={light: lamp}", "model=haptic"], "no recording has light lamp; choose"),
        ([FAST, "task=crossval"], "data.test_where is read by task=fit"),
        (["data.per_class=2", "task=evaluate", "checkpoint=a"], "data.per_class is read by"),
        (["crossval.only=[0]"], "crossval.only is read by task=crossval, task=frontier alone"),
        (["stability.only=[hum]"], "stability.only is read by task=stability alone"),
    ],
)
def test_what_cannot_be_meant_is_refused(cli, manifest, tmp_path, arguments, message):
    outcome = cli(*given(manifest, tmp_path), *arguments)
    assert outcome.status == 2
    assert message in outcome.err
