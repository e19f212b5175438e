"""Real recordings beside the checkout; skipped where there are none."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tex_lightning as tl


def networks(directory: Path) -> dict:
    return json.loads((directory / "results.json").read_text())["networks"]


def test_real_recordings_run_from_reading_to_results(cli, shared, tmp_path):
    outcome = cli(
        "model=haptic",
        "data=folder",
        f"data.root={shared}/data/lmt16",
        "data.classes=3",
        "debug=tiny",
        f"hydra.run.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    assert networks(tmp_path)["haptic"]["test_samples"] == 3


def test_the_live_label_of_a_real_surface_follows_within_a_second_and_a_half(cli, shared, tmp_path):
    outcome = cli(
        "experiment=few/haptic",
        "data=folder",
        f"data.root={shared}/data/lmt16",
        "data.classes=3",
        f"hydra.run.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    model = tl.load(tmp_path, "stream.window=2")
    old, new = model.card.classes[0], model.card.classes[2]
    files = [min((shared / "data/lmt16" / name / "haptic").iterdir()) for name in (old, new)]
    traces = [soundfile.read(file, dtype="float32")[0][:47_000] for file in files]
    stream = model.stream()
    said = [stream.push(chunk).label for chunk in np.split(np.concatenate(traces), 94)]
    assert set(said[9:47]) == {old}
    assert set(said[62:]) == {new}


@pytest.mark.slow
def test_hapticnet_on_three_folds_of_sixteen_real_surfaces(cli, shared, tmp_path):
    outcome = cli(
        "model=haptic",
        "data=folder",
        f"data.root={shared}/data/lmt16",
        "task=crossval",
        "crossval.only=[0,1,2]",
        f"hydra.run.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    assert networks(tmp_path)["haptic"]["vote_accuracy"] >= 0.95


@pytest.mark.slow
def test_fusion_beats_both_networks_on_synthetic_surfaces(cli, tmp_path):
    assert cli("model=fusion", f"hydra.run.dir={tmp_path}").status == 0
    found = {name: network["vote_accuracy"] for name, network in networks(tmp_path).items()}
    assert found["fusion"] >= 0.97
    assert found["fusion"] > max(found["haptic"], found["visual"])


@pytest.mark.slow
def test_fusion_stands_by_hapticnet_where_visualnet_errs(cli, shared, tmp_path):
    outcome = cli(
        "model=fusion_efficientnet",
        "data=manifest",
        f"data.manifest={shared}/data/surfaces10.csv",
        "data.half_scale=false",
        "weights=imagenet",
        "task=crossval",
        "crossval.only=[3]",
        f"hydra.run.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    found = {name: network["vote_accuracy"] for name, network in networks(tmp_path).items()}
    assert found["visual"] < found["fusion"]
    assert found["fusion"] >= found["haptic"]
