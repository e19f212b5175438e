"""Files of published weights: those of Caffe, and those that are refused."""

from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import visualnet as make
from scipy.signal import correlate

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
CONV1 = {"conv1": (96, 3, 11, 11)}


def fabricate(shapes):
    """Weights and bias of every layer."""
    rng = np.random.default_rng(0)
    return {
        name: (
            (0.05 * rng.standard_normal(shape)).astype(np.float32),
            rng.standard_normal(shape[0]).astype(np.float32),
        )
        for name, shape in shapes.items()
    }


def named(arrays):
    pairs = {name: zip(("weight", "bias"), pair, strict=True) for name, pair in arrays.items()}
    return {f"{name}.{kind}": array for name, pair in pairs.items() for kind, array in pair}


def save(path, arrays):
    """Write a file of weights in the format of its suffix."""
    match path.suffix:
        case ".npz":
            np.savez(path, **named(arrays))
        case ".pth":
            torch.save({key: torch.from_numpy(x) for key, x in named(arrays).items()}, path)
    return path


def visualnet(trunk="alexnet_caffe", norm="none", **options):
    return make(3, trunk=trunk, norm=norm, **options).eval()


def assert_conv1(net, planes, weight, bias, photo):
    """Compare conv1 on the photo with SciPy's correlation of ``planes``, as the file means it."""
    mean, sd = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    scaled = torch.from_numpy((photo / 255 - mean[:, None, None]) / sd[:, None, None])
    with torch.no_grad():
        found = net.trunk.layers.conv1[0](scaled[None].float())[0].numpy()
    for out in (0, 17, 95):
        expected = correlate(planes, weight[out], "valid")[0, ::4, ::4] + bias[out]
        assert found[out].shape == expected.shape
        assert np.abs(found[out] - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("trunk", ["alexnet_caffe", "tcnn"])
def test_a_converted_file_gives_caffes_conv1_and_the_other_layers_as_they_are(tmp_path, trunk):
    arrays = fabricate(ALEXNET)
    path = save(tmp_path / "a.npz", arrays)
    net = visualnet(trunk, norm="lrn")
    convolutions = 3 if trunk == "tcnn" else 5
    message = load_trunk_weights(net.trunk, path)
    assert message == f"{trunk} trunk from {path} (caffe layout, {2 * convolutions} tensors)"
    photo = np.random.default_rng(1).integers(0, 256, (3, 47, 47)).astype(np.float64)  # RGB
    bgr = photo[::-1] - np.array([104.0, 117.0, 123.0])[:, None, None]
    assert_conv1(net, bgr, *arrays["conv1"], photo)
    weight = net.trunk.layers.conv2[0].weight.detach().numpy()
    np.testing.assert_array_equal(weight, arrays["conv2"][0])


def test_the_first_layer_is_as_many_times_as_large_as_the_page_of_the_paper_says(tmp_path):
    arrays, net = fabricate(ALEXNET), visualnet()
    load_trunk_weights(net.trunk, save(tmp_path / "weights.npz", arrays))
    loaded = net.trunk.layers.conv1[0].weight.detach()
    larger = (loaded / torch.from_numpy(arrays["conv1"][0]).flip(1)).round()
    page = (Path(__file__).parents[2] / "docs" / "paper.md").read_text("utf-8")
    assert f"{larger.min():.0f} to {larger.max():.0f} times as large" in page


def test_vgg_m_normalises_as_its_files_say():
    """MatConvNet's parameters [5 2 1e-4 0.75]: x_i / (2 + 1e-4 sum of 5 squares)^0.75."""
    x = 100 * np.random.default_rng(0).standard_normal((96, 3, 3))
    layer = visualnet("vgg_m", norm="lrn").trunk.layers.pool1[0]
    found = layer(torch.from_numpy(x[None]))[0].numpy()
    for channel in (0, 1, 40, 95):
        near = x[max(0, channel - 2) : channel + 3]
        expected = x[channel] / (2 + 1e-4 * (near**2).sum(0)) ** 0.75
        np.testing.assert_allclose(found[channel], expected, rtol=1e-6)


def test_features_are_divided_by_one_number(tmp_path):
    arrays, net = fabricate(ALEXNET), visualnet()
    load_trunk_weights(net.trunk, save(tmp_path / "weights.npz", arrays))
    last = net.trunk.state_dict()["layers.conv5.0.weight"] / torch.from_numpy(arrays["conv5"][0])
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
        refused(visualnet(), tmp_path / name, name, "reads .npz")
    refused(visualnet(width=0.5), "imagenet", "width=1")
    refused(visualnet(norm="batch"), "imagenet", "norm=batch")


@pytest.mark.parametrize("suffix", [".npz", ".pth"])
def test_truncated_files_and_files_of_something_else(tmp_path, suffix):
    net = visualnet("efficientnet_lite0" if suffix == ".pth" else "alexnet_caffe")
    path = save(tmp_path / f"weights{suffix}", fabricate(CONV1))
    content = path.read_bytes()
    parts = [content[: int(kept * len(content))] for kept in (0.0, 0.5, 0.999)]
    for wrong in (*parts, b"<html>not found</html>", bytes(range(256)) * 9, b"\x80" * 99):
        path.write_bytes(wrong)
        refused(net, path, str(path), "cannot be read")


@pytest.mark.parametrize("content", [{"_conv_stem.weight": Path("/")}, [1, 2]])
def test_what_is_no_state_dict_is_refused_and_not_run(tmp_path, content):
    torch.save(content, tmp_path / "weights.pth")
    refused(visualnet("efficientnet_lite0"), tmp_path / "weights.pth", "cannot be read")


def test_weights_of_another_network(tmp_path):
    arrays = fabricate(ALEXNET)
    path = save(tmp_path / "alexnet.npz", arrays)
    refused(visualnet("vgg_m"), path, "conv1.weight", "(96, 3, 11, 11)", "(96, 3, 7, 7)")
    np.savez(path, **{name: x for name, x in named(arrays).items() if name != "conv4.bias"})
    refused(visualnet(), path, "has no conv4.bias", "alexnet_caffe")


@pytest.mark.parametrize("value", [3e38, float("nan"), float("inf")])
def test_numbers_must_be_finite_and_not_overflow(tmp_path, value):
    arrays = fabricate(ALEXNET)
    arrays["conv3"][1][7] = value
    refused(
        visualnet("tcnn"), save(tmp_path / "a.npz", arrays), "conv3.bias", "not finite, or huge"
    )
