"""Weights for the trunks of one run or of a whole sweep."""

import json

import pytest
import torch

import tex_lightning as tl
from tex_lightning.config import Config
from tex_lightning.config.check import check_config, read_config
from tex_lightning.config.composition import compose_config
from tex_lightning.errors import UserError

SOURCES = "{alexnet_caffe:a.npz,vgg_m:v.npz,efficientnet_lite0:imagenet}"


def config(model: str, weights: str) -> Config:
    return read_config(compose_config([f"model={model}", f"weights={weights}"]))


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ("visual", "a.npz"),
        ("vgg_m_fv", "v.npz"),
        ("fusion_efficientnet", "imagenet"),
        ("visual_tcnn", None),
        ("lbp", None),
    ],
)
def test_each_model_finds_its_trunk(model, expected):
    assert next(iter(config(model, SOURCES).sources.values()), None) == expected
    assert [*config(model, "x.npz").sources.values()] == ["x.npz"]


@pytest.mark.parametrize(
    ("weights", "said"),
    [
        ("{vgg: v.mat}", "in weights is vgg .did you mean vgg_m"),
        ("3", "weights is"),
    ],
)
def test_other_weights_are_refused(weights, said):
    with pytest.raises(UserError, match=said):
        check_config(config("visual", weights))


def test_a_network_starts_from_its_trunk_and_inherits_what_it_has_seen(
    run_once, fused, tiny, cli, tmp_path
):
    """It hardly moves from a run on the same folds."""
    weights = f"weights={{haptic:{fused}/checkpoints/haptic.ckpt}}"
    still = "model.haptic.fit.learning_rate=1e-12"
    run = run_once("model=haptic", still, weights, *tiny)
    first = {f"{fused}/checkpoints/haptic.ckpt": run, "random weights": fused}
    for source, folder in first.items():
        assert json.loads((folder / "results.json").read_text())["weights"]["haptic"] == source
    start, end = (
        tl.load(each / "checkpoints" / "haptic.ckpt").classifier.state_dict()
        for each in (fused, run)
    )
    key = "senses.haptic.network.trunk.0.weight"
    torch.testing.assert_close(start[key], end[key], rtol=0, atol=1e-9)
    assert tl.load(run).card.trained_on["trunks"].keys() == {"haptic"}
    begun = f"weights={run}/checkpoints/haptic.ckpt"
    leak = cli("model=haptic", begun, "data.test_fold=3", *tiny, f"hydra.run.dir={tmp_path}")
    assert leak.status == 2
    assert "has trained on 3 of the 3 test recordings" in leak.err
    assert "set data.folds=10 data.test_fold=0 as in" in leak.err
