"""Published files of Caffe, written by Google's protobuf."""

import numpy as np
import pytest
import torch
from conftest import visualnet as make
from scipy.signal import correlate

from tex_lightning.errors import UserError
from tex_lightning.networks.weights import caffe_network, load_trunk_weights, read_caffemodel

ALEXNET = {
    "conv1": (96, 3, 11, 11),
    "conv2": (256, 48, 5, 5),
    "conv3": (384, 256, 3, 3),
    "conv4": (384, 192, 3, 3),
    "conv5": (256, 192, 3, 3),
    "fc8": (10, 20),
}
VGG_M = {
    "conv1": (96, 3, 7, 7),
    "conv2": (256, 96, 5, 5),
    "conv3": (512, 256, 3, 3),
    "conv4": (512, 512, 3, 3),
    "conv5": (512, 512, 3, 3),
    "fc8": (10, 20),
}
SHAPES = {"alexnet_caffe": ALEXNET, "tcnn": ALEXNET, "vgg_m": VGG_M}
STRIDES = {"alexnet_caffe": 4, "tcnn": 4, "vgg_m": 2}


def fabricate(shapes):
    rng = np.random.default_rng(0)
    return {
        name: (
            (0.05 * rng.standard_normal(shape)).astype(np.float32),
            rng.standard_normal(shape[0]).astype(np.float32),
        )
        for name, shape in shapes.items()
    }


def write_caffemodel(path, arrays, form="layers"):
    net = caffe_network()()
    for name, pair in arrays.items():
        old = form != "layer"
        layer = net.layers.add(name=name) if old else net.layer.add(name=name)
        for array in pair:
            blob = layer.blobs.add()
            if old:
                shape = (1,) * (4 - array.ndim) + array.shape
                blob.num, blob.channels, blob.height, blob.width = shape
            else:
                blob.shape.dim.extend(array.shape)
            (blob.double_data if form == "double" else blob.data).extend(array.ravel().tolist())
    path.write_bytes(net.SerializeToString())
    return path


def visualnet(trunk, norm="lrn"):
    return make(3, trunk=trunk, norm=norm).eval()


def photo():
    return np.random.default_rng(1).integers(0, 256, (3, 47, 47)).astype(np.float64)  # RGB


def normalised(rgb):
    mean, sd = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    scaled = (rgb / 255 - mean[:, None, None]) / sd[:, None, None]
    return torch.from_numpy(scaled[None]).float()


def assert_conv1(net, trunk, planes, weight, bias):
    """Compare conv1 on the photo with SciPy's correlation of ``planes``, as the file means it."""
    with torch.no_grad():
        found = net.trunk.layers.conv1[0](normalised(photo()))[0].numpy()
    stride = STRIDES[trunk]
    for out in (0, 17, 95):
        expected = correlate(planes, weight[out], "valid")[0, ::stride, ::stride] + bias[out]
        assert found[out].shape == expected.shape
        assert np.abs(found[out] - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("form", ["layers", "layer", "double"])
def test_every_form_of_the_format_is_read(tmp_path, form):
    arrays = fabricate({"conv1": (6, 3, 2, 2), "fire2/squeeze": (4, 6, 1, 1)})
    path = write_caffemodel(tmp_path / "a.caffemodel", arrays, form)
    found = read_caffemodel(path, arrays)
    assert len(found) == 4
    for name, (weight, bias) in arrays.items():
        np.testing.assert_array_equal(found[f"{name}.weight"], weight)
        np.testing.assert_array_equal(found[f"{name}.bias"], bias)
    assert read_caffemodel(path, ["conv1"]).keys() == {"conv1.weight", "conv1.bias"}


def test_the_fields_are_those_of_caffes_own_files(tmp_path):
    """Tags of the wire format, (number << 3 | type): a layer 100 and its name 1 and blob 7."""
    floats = np.float32([1, 2, 3]).tobytes()
    blob = b"\x2a\x0c" + floats + b"\x3a\x03\x0a\x01\x03"
    layer = b"\x0a\x05conv1" + b"\x12\x04Conv" + b"\x3a" + bytes([len(blob)]) + blob
    (tmp_path / "a.caffemodel").write_bytes(b"\x0a\x03Net\xa2\x06" + bytes([len(layer)]) + layer)
    found = read_caffemodel(tmp_path / "a.caffemodel", ["conv1"])
    np.testing.assert_array_equal(found["conv1.weight"], [1, 2, 3])


@pytest.mark.parametrize("trunk", ["alexnet_caffe", "tcnn"])
def test_caffemodel_gives_caffes_conv1_and_the_other_layers_as_they_are(tmp_path, trunk):
    arrays = fabricate(SHAPES[trunk])
    path = write_caffemodel(tmp_path / "a.caffemodel", arrays)
    net = visualnet(trunk)
    convolutions = 3 if trunk == "tcnn" else 5
    message = load_trunk_weights(net.trunk, path)
    assert message == f"{trunk} trunk from {path} (caffe layout, {2 * convolutions} tensors)"
    bgr = photo()[::-1] - np.array([104.0, 117.0, 123.0])[:, None, None]
    assert_conv1(net, trunk, bgr, *arrays["conv1"])
    weight = net.trunk.layers.conv2[0].weight.detach().numpy()
    np.testing.assert_array_equal(weight, arrays["conv2"][0])


def test_vgg_m_normalises_as_its_files_say():
    """MatConvNet's parameters [5 2 1e-4 0.75]: x_i / (2 + 1e-4 sum of 5 squares)^0.75."""
    x = 100 * np.random.default_rng(0).standard_normal((96, 3, 3))
    layer = visualnet("vgg_m").trunk.layers.pool1[0]
    found = layer(torch.from_numpy(x[None]))[0].numpy()
    for channel in (0, 1, 40, 95):
        near = x[max(0, channel - 2) : channel + 3]
        expected = x[channel] / (2 + 1e-4 * (near**2).sum(0)) ** 0.75
        np.testing.assert_allclose(found[channel], expected, rtol=1e-6)


def refused(net, path, *parts):
    with pytest.raises(UserError) as caught:
        load_trunk_weights(net.trunk, path)
    assert str(caught.value).startswith("weights")
    assert all(part in str(caught.value) for part in parts), caught.value


@pytest.mark.parametrize("kept", [0.0, 0.3, 0.999])
def test_truncated_files(tmp_path, kept):
    path = write_caffemodel(tmp_path / "a.caffemodel", fabricate({"conv1": (96, 3, 7, 7)}))
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    refused(visualnet("vgg_m"), path, str(path), "cannot be read")


@pytest.mark.parametrize(
    "content", [b"<html>not found</html>", bytes(range(256)) * 9, b"\x80" * 99]
)
def test_files_of_something_else(tmp_path, content):
    path = tmp_path / "a.caffemodel"
    path.write_bytes(content)
    refused(visualnet("vgg_m"), path, "cannot be read")
