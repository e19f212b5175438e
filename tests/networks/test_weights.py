"""Files of weights that cannot be used, and the size of the features of those that can."""

from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import visualnet as make

from tex_lightning.errors import UserError
from tex_lightning.networks.weights import load_trunk_weights

ALEXNET = {
    "conv1": (96, 3, 11, 11),
    "conv2": (256, 48, 5, 5),
    "conv3": (384, 256, 3, 3),
    "conv4": (384, 192, 3, 3),
    "conv5": (256, 192, 3, 3),
    "fc8": (10, 20),
}


def fabricate(shapes):
    generator = torch.Generator().manual_seed(0)
    state = {}
    for name, shape in shapes.items():
        state[f"{name}.weight"] = 0.05 * torch.randn(shape, generator=generator)
        state[f"{name}.bias"] = torch.randn(shape[0], generator=generator)
    return state


def save_npz(path, state):
    np.savez(path, **{name: value.numpy() for name, value in state.items()})
    return path


def visualnet(trunk="alexnet_caffe", norm="none", **options):
    return make(3, trunk=trunk, norm=norm, **options).eval()


def test_features_are_divided_by_one_number(tmp_path):
    state, net = fabricate(ALEXNET), visualnet()
    path = save_npz(tmp_path / "weights.npz", state)
    message = load_trunk_weights(net.trunk, path)
    assert message == f"alexnet_caffe trunk from {path} (caffe layout, 10 tensors)"
    loaded = net.trunk.state_dict()
    assert torch.equal(loaded["layers.conv2.0.weight"], state["conv2.weight"])
    last = loaded["layers.conv5.0.weight"] / state["conv5.weight"]
    torch.testing.assert_close(last, last.flatten()[0].expand_as(last))
    noise = torch.randn(1, 3, 224, 224, generator=torch.Generator().manual_seed(1))
    assert 0.5 < net.trunk(noise).square().mean().sqrt() < 2


def refused(net, source, *parts):
    before = {name: value.clone() for name, value in net.state_dict().items()}
    with pytest.raises(UserError) as caught:
        load_trunk_weights(net.trunk, source)
    text = str(caught.value)
    assert text.startswith("weights")
    assert all(part in text for part in parts), text
    assert all(torch.equal(value, before[name]) for name, value in net.state_dict().items())


def test_what_is_no_file_of_this_trunk_is_refused(tmp_path):
    refused(visualnet(), "imagenet", "not available for alexnet_caffe")
    refused(visualnet(), tmp_path / "none.npz", "there is no file", "none.npz")
    for name in ("weights.h5", "weights.pth"):
        (tmp_path / name).touch()
        refused(visualnet(), tmp_path / name, name, "reads .npz, .caffemodel")
    refused(visualnet(width=0.5), "imagenet", "width=1")
    refused(visualnet(norm="batch"), "imagenet", "norm=batch")


@pytest.mark.parametrize("suffix", [".npz", ".pth"])
@pytest.mark.parametrize("kept", [0.0, 0.5, 0.999])
def test_truncated_file(tmp_path, suffix, kept):
    path = tmp_path / f"weights{suffix}"
    state = fabricate({"conv1": (96, 3, 11, 11)})
    save_npz(path, state) if suffix == ".npz" else torch.save(state, path)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    net = visualnet("alexnet_caffe" if suffix == ".npz" else "efficientnet_lite0")
    refused(net, path, str(path), "cannot be read")


@pytest.mark.parametrize("content", [{"_conv_stem.weight": Path("/")}, [1, 2]])
def test_what_is_no_state_dict_is_refused_and_not_run(tmp_path, content):
    path = tmp_path / "weights.pth"
    torch.save(content, path)
    refused(visualnet("efficientnet_lite0"), path, "cannot be read")


def test_weights_of_another_network(tmp_path):
    state = fabricate(ALEXNET)
    path = save_npz(tmp_path / "alexnet.npz", state)
    refused(visualnet("vgg_m"), path, "conv1.weight", "(96, 3, 11, 11)", "(96, 3, 7, 7)")
    del state["conv4.bias"]
    refused(visualnet(), save_npz(path, state), "has no conv4.bias", "alexnet_caffe")


@pytest.mark.parametrize("value", [3e38, float("nan"), float("inf")])
def test_numbers_must_be_finite_and_not_overflow(tmp_path, value):
    state = fabricate(ALEXNET)
    state["conv3.bias"][7] = value
    path = save_npz(tmp_path / "alexnet.npz", state)
    refused(visualnet("tcnn"), path, "conv3.bias", "is not finite, or huge")
