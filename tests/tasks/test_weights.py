"""Weights for the trunks of one run or of a whole sweep."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from tex_lightning.config import CONF, Config, register
from tex_lightning.config.weights import pick_weights
from tex_lightning.errors import UserError

GIVEN = {
    "alexnet_caffe": "a.caffemodel",
    "vgg_m": "v.mat",
    "efficientnet_lite0": "imagenet",
}


def config(model: str) -> Config:
    register()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return OmegaConf.to_object(compose("config", overrides=[f"model={model}"]))


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ("visual", "a.caffemodel"),
        ("alexnet_fv", "a.caffemodel"),
        ("visual_vgg_m", "v.mat"),
        ("vgg_m_fv", "v.mat"),
        ("fusion_efficientnet", "imagenet"),
        ("visual_tcnn", None),
        ("haptic", None),
        ("lbp", None),
    ],
)
def test_each_model_finds_its_trunk(model, expected):
    assert pick_weights(replace(config(model), weights=GIVEN)).weights == expected
    assert pick_weights(replace(config(model), weights="x.npz")).weights == "x.npz"


@pytest.mark.parametrize("weights", [{"resnet": "r.pth"}, ["a", "b"], 3])
def test_other_weights_are_refused(weights):
    with pytest.raises(UserError, match="not understood"):
        pick_weights(replace(config("visual"), weights=weights))


def test_command_line_takes_a_mapping(cli, tmp_path):
    outcome = cli(
        "model=visual", "debug=tiny", "weights={vgg_m:nowhere.npz}", "data.classes=2",
        f"hydra.run.dir={tmp_path}/r",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err


def real(surfaces: Path) -> list[str]:
    return [
        "data=folder", f"data.root={surfaces}", "data.half_scale=false", "data.val_fold=null",
        "debug=tiny", "trainer.threads=1", "data.num_workers=0",
    ]  # fmt: skip


TCNN = ["trunk=tcnn", "model.visual.width=0.1"]


@pytest.fixture(scope="module")
def haptic(run_once, surfaces) -> Path:
    return run_once("model=haptic", *real(surfaces))


@pytest.fixture(scope="module")
def visual(run_once, surfaces) -> Path:
    return run_once("model=visual", *TCNN, *real(surfaces))


@pytest.fixture(scope="module")
def fused(run_once, surfaces, haptic, visual) -> Path:
    """A FusionNet from both trunks, of which HapticNet's hardly moves."""
    files = f"{{haptic:{haptic}/checkpoints/haptic.ckpt,tcnn:{visual}/checkpoints/visual.ckpt}}"
    return run_once(
        "model=fusion_tcnn", "model.visual.width=0.1", "model.haptic.fit.learning_rate=1e-12",
        f"weights={files}", *real(surfaces),
    )  # fmt: skip


def test_both_parts_of_a_fusion_start_from_their_trunks(haptic, fused):
    found = json.loads((fused / "results.json").read_text())
    assert list(found["weights"]) == ["haptic", "visual"]
    for source in found["weights"].values():
        assert "(trained on 27 recordings)" in source
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
