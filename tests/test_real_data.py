"""Real recordings beside the checkout; skipped where there are none."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tex_lightning as tl
from benchmarks import unknown
from tex_lightning.evaluation.outcomes import wilson_interval


@pytest.fixture
def networks(cli, tmp_path):
    """Give the networks of the results of a run."""

    def run(*arguments: str) -> dict:
        outcome = cli(*arguments, f"hydra.run.dir={tmp_path}")
        assert outcome.status == 0, outcome.err
        return json.loads((tmp_path / "results.json").read_text())["networks"]

    return run


def votes(networks: dict) -> dict[str, float]:
    return {name: network["vote_accuracy"] for name, network in networks.items()}


@pytest.mark.slow
def test_the_live_label_of_a_real_surface_follows_within_a_second_and_a_half(
    networks, shared, tmp_path
):
    lmt = ("data=folder", f"data.root={shared}/data/lmt16", "data.classes=3")
    assert networks("experiment=few/haptic", *lmt)["haptic"]["test_samples"] == 3
    model = tl.load(tmp_path, "stream.window=2")
    old, new = model.card.classes[0], model.card.classes[2]
    files = [min((shared / "data/lmt16" / name / "haptic").iterdir()) for name in (old, new)]
    traces = [soundfile.read(file, dtype="float32")[0][:47_000] for file in files]
    stream = model.stream()
    said = [stream.push(chunk).label for chunk in np.split(np.concatenate(traces), 94)]
    assert set(said[9:47]) == {old}
    assert set(said[62:]) == {new}


@pytest.mark.slow
def test_hapticnet_on_three_folds_of_sixteen_real_surfaces(networks, shared):
    lmt = ("data=folder", f"data.root={shared}/data/lmt16")
    found = networks("model=haptic", *lmt, "task=crossval", "crossval.only=[0,1,2]")
    assert votes(found)["haptic"] >= 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lmt16", "synthetic"])
def test_unknown_materials_are_told_as_the_page_says(shared, name):
    found = unknown.measure(name)[name]
    rejected, accepted = (found[key] for key in unknown.SHARES)
    low, high = wilson_interval(rejected["count"], rejected["of"])
    assert low <= unknown.RATE <= high
    assert accepted["share"] <= 0.02
    page = (Path(__file__).parents[1] / "docs" / "calibration.md").read_text("utf-8")
    for counts in (rejected, accepted):
        assert f"({counts['count']}/{counts['of']})" in page


@pytest.mark.slow
def test_fusion_beats_both_networks_on_synthetic_surfaces(networks):
    found = votes(networks("model=fusion"))
    assert found["fusion"] >= 0.97
    assert found["fusion"] > max(found["haptic"], found["visual"])


@pytest.mark.slow
def test_fusion_stands_by_hapticnet_where_visualnet_errs(networks, shared):
    surfaces = ("data=manifest", f"data.manifest={shared}/data/surfaces10.csv")
    options = ("data.half_scale=false", "weights=imagenet", "task=crossval", "crossval.only=[3]")
    found = votes(networks("model=fusion_efficientnet", *surfaces, *options))
    assert found["visual"] < found["fusion"]
    assert found["fusion"] >= found["haptic"]
