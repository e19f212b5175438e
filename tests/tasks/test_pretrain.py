"""Pre-training and what starts from it, through the command line."""

import json
from pathlib import Path

import pytest
import torch

TINY = [
    "debug=tiny", "trainer.threads=1", "data.num_workers=0", "model.haptic.fit.batch_size=2",
]  # fmt: skip
SURFACES = ["data.classes=3", "data.synthetic.recordings=1", "data.synthetic.seconds=3"]


@pytest.fixture(scope="module")
def haptic(run_once) -> Path:
    return run_once("task=pretrain", "model=haptic", *SURFACES, *TINY)


@pytest.fixture(scope="module")
def visual(run_once) -> Path:
    small = ["data.synthetic.photo_width=240", "data.synthetic.photo_height=240"]
    return run_once(
        "task=pretrain", "model=visual", "model/trunk=tcnn", "model.visual.width=0.1", *SURFACES,
        *TINY, *small,
    )  # fmt: skip


def results(run: Path) -> dict:
    return json.loads((run / "results.json").read_text())


@pytest.mark.parametrize("kind", ["haptic", "visual"])
def test_a_run_says_that_its_surfaces_are_synthetic(kind, request):
    run = request.getfixturevalue(kind)
    found = results(run)
    assert found["task"] == "pretrain"
    assert "synthetic specimens" in found["tested_on"]
    assert found["networks"][kind]["test_samples"] == 2
    assert (run / "figures" / f"{kind}_confusion.png").is_file()
    card = torch.load(run / "checkpoints" / f"{kind}.ckpt", weights_only=True)
    card = card["hyper_parameters"]["card"]
    assert card["trained_on"]["stream"]["classes"] == len(card["classes"]) == 3
    assert card["trained_on"]["seen"] == []


def real(surfaces: Path) -> list[str]:
    return ["data=folder", f"data.root={surfaces}", "data.half_scale=false", *TINY]


@pytest.fixture(scope="module")
def fused(run_once, surfaces, haptic, visual) -> Path:
    """A FusionNet from both trunks, of which HapticNet's hardly moves."""
    files = f"{{haptic:{haptic}/checkpoints/haptic.ckpt,tcnn:{visual}/checkpoints/visual.ckpt}}"
    return run_once(
        "model=fusion_tcnn", "model.visual.width=0.1", "model.haptic.fit.learning_rate=1e-12",
        "data.val_fold=null", f"weights={files}", *real(surfaces),
    )  # fmt: skip


def test_both_parts_of_a_fusion_start_from_their_trunks(haptic, fused):
    found = results(fused)
    assert "trained on synthetic surfaces of 3 classes" in found["trunk_weights"]
    assert "trained on synthetic surfaces of 3 classes" in found["haptic_trunk_weights"]
    key = "classifier.network.trunk.0.weight"
    start, end = (
        torch.load(run / "checkpoints" / "haptic.ckpt", weights_only=True)["state_dict"][key]
        for run in (haptic, fused)
    )
    torch.testing.assert_close(start, end, rtol=0, atol=1e-9)
    card = torch.load(fused / "checkpoints" / "fusion.ckpt", weights_only=True)["hyper_parameters"]
    assert card["card"]["trained_on"]["trunks"].keys() == {"haptic", "visual"}


def test_a_trunk_that_has_seen_the_test_fold_is_refused(cli, surfaces, fused, tmp_path):
    weights = f"weights={fused}/checkpoints/haptic.ckpt"
    leak = cli(
        "model=haptic", weights, "data.test_fold=3", *real(surfaces), f"hydra.run.dir={tmp_path}"
    )
    assert leak.status == 2
    assert "has trained on 3 of the 3 test recordings" in leak.err
    assert "set data.folds=10 data.test_fold=0 as in" in leak.err


def test_the_trunk_that_comes_with_the_package(cli, surfaces, tmp_path):
    outcome = cli(
        "model=haptic", "weights=synthetic", *real(surfaces), "model.haptic.width=0.5",
        f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    said = results(tmp_path)["trunk_weights"]
    assert said == "synthetic (trained on synthetic surfaces of 200 classes)"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["model=fusion"], "trains HapticNet or VisualNet, not model=fusion"),
        (["model=lbp"], "trains HapticNet or VisualNet, not model=lbp"),
        (["model=haptic", "data=folder", "data.root=x"], "renders its own surfaces"),
        (["model=haptic", "data.sampling_rate=8000"], "rendered traces have 10000"),
        (["model=haptic", "data.synthetic.seconds=1"], "choose from 3 to 600"),
        (["model=haptic", "pretrain.views=0"], "pretrain.views is 0: choose from 1"),
        (["model=visual", "model.visual.fit.perturb=[jpeg]"], "perturb is not read"),
        (["model=visual", "weights=imagenet"], "weights are read by task=fit"),
        (["model=visual", "data.synthetic.photo_width=100"], "this network needs"),
    ],
)
def test_what_cannot_be_meant_is_said(cli, arguments, message, tmp_path):
    outcome = cli("task=pretrain", *arguments, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert message in outcome.err
