"""One sweep, weights for several trunks."""

from dataclasses import replace

import pytest
from hydra import compose, initialize_config_dir
from omegaconf import OmegaConf

from tex_lightning.config import CONF, Config, register
from tex_lightning.config.weights import pick_weights
from tex_lightning.errors import UserError

GIVEN = {"alexnet_caffe": "a.caffemodel", "squeezenet": "s.npz"}


def config(model: str) -> Config:
    register()
    with initialize_config_dir(str(CONF), version_base="1.3"):
        return OmegaConf.to_object(compose("config", overrides=[f"model={model}"]))


@pytest.mark.parametrize(
    ("model", "expected"),
    [
        ("visual", "a.caffemodel"),
        ("alexnet_fv", "a.caffemodel"),
        ("fusion_squeezenet", "s.npz"),
        ("squeezenet_linear", "s.npz"),
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
        "model=visual", "debug=tiny", "weights={squeezenet:nowhere.npz}", "data.classes=2",
        f"hydra.run.dir={tmp_path}/r",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
