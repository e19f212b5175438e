"""Networks that several runs find in one folder."""

import json

import pytest
import torch

pytestmark = pytest.mark.slow  # three FusionNets


@pytest.fixture(scope="module")
def runs(run_once, surfaces, tmp_path_factory):
    """The same FusionNet, deciding otherwise, and one trained otherwise."""
    shared = tmp_path_factory.mktemp("shared")
    given = (
        "task=crossval", "crossval.only=[0]", "model=fusion", "model.visual.width=0.1",
        "data=folder", f"data.root={surfaces}", "data.half_scale=false", "debug=tiny",
        f"crossval.share={shared}",
    )  # fmt: skip
    whole = run_once(*given)
    sequential = run_once(*given, "decision=sequential")
    counts = len(list(shared.glob("fusion-*")))
    run_once(*given, "model.fusion.fit.modality_dropout=0.5")
    return shared, whole, sequential, counts


def test_a_fusion_network_is_trained_once_however_it_decides(runs):
    _, whole, sequential, counts = runs
    assert counts == 1
    weights = [
        torch.load(run / "folds/0/checkpoints/fusion.ckpt", weights_only=True)["state_dict"]
        for run in (whole, sequential)
    ]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])
    decided = json.loads((sequential / "results.json").read_text())["networks"]
    assert list(decided) == ["haptic", "visual", "fusion"]


def test_another_recipe_of_fusion_is_another_network_of_the_same_parts(runs):
    shared = runs[0]
    kinds = [place.name.split("-")[0] for place in shared.iterdir()]
    assert sorted(kinds) == ["fusion", "fusion", "haptic", "visual"]
