"""Weights for the trunks of one run or of a whole sweep."""

import json
import re
from dataclasses import replace

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


def test_both_parts_of_a_fusion_start_from_their_trunks(run_once, fused, tiny, cli, tmp_path):
    """Of a run on the same folds, of which HapticNet's hardly moves."""
    files = {"haptic": "haptic", "alexnet_caffe": "visual"}
    weights = ",".join(f"{each}:{fused}/checkpoints/{kind}.ckpt" for each, kind in files.items())
    still = "model.haptic.fit.learning_rate=1e-12"
    run = run_once("model=fusion", still, f"weights={{{weights}}}", *tiny)
    found = json.loads((run / "results.json").read_text())
    assert list(found["weights"]) == ["haptic", "visual"]
    for source in found["weights"].values():
        assert re.search(r"\(trained on \d+ recordings\)", source)
    key = "classifier.senses.haptic.network.trunk.0.weight"
    start, end = (
        torch.load(each / "checkpoints" / "haptic.ckpt", weights_only=True)["state_dict"][key]
        for each in (fused, run)
    )
    torch.testing.assert_close(start, end, rtol=0, atol=1e-9)
    card = torch.load(run / "checkpoints" / "fusion.ckpt", weights_only=True)["hyper_parameters"]
    assert card["card"]["trained_on"]["trunks"].keys() == {"haptic", "visual"}
    start = f"weights={run}/checkpoints/haptic.ckpt"
    leak = cli("model=haptic", start, "data.test_fold=3", *tiny, f"hydra.run.dir={tmp_path}")
    assert leak.status == 2
    assert "has trained on 3 of the 3 test recordings" in leak.err
    assert "set data.folds=10 data.test_fold=0 as in" in leak.err
