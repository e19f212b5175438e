"""Importing weights against an independent Caffe-style computation, and every refusal."""

import hashlib
import urllib.error
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from conftest import visualnet as make

from tex_lightning.errors import UserError
from tex_lightning.networks.weights import load_trunk_weights

ALEXNET_TORCHVISION = {
    "features.0": (64, 3, 11, 11),
    "features.3": (192, 64, 5, 5),
    "features.6": (384, 192, 3, 3),
    "features.8": (256, 384, 3, 3),
    "features.10": (256, 256, 3, 3),
    "classifier.6": (10, 20),
}
ALEXNET_CAFFE = {
    "conv1": (96, 3, 11, 11),
    "conv2": (256, 48, 5, 5),
    "conv3": (384, 256, 3, 3),
    "conv4": (384, 192, 3, 3),
    "conv5": (256, 192, 3, 3),
    "fc8": (10, 20),
}


TRUNK_OF = {".npz": "alexnet_caffe", ".pth": "alexnet_torchvision", ".pt": "alexnet_torchvision"}


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


def visualnet(trunk="alexnet_torchvision", norm="none", **options):
    return make(3, trunk=trunk, norm=norm, **options).eval()


def photo(side=64):
    return np.random.default_rng(0).integers(0, 256, (side, side, 3), dtype=np.uint8)


def normalised(rgb):
    """Return the input that every trunk documents."""
    scaled = (rgb / 255 - np.array([0.485, 0.456, 0.406])) / np.array([0.229, 0.224, 0.225])
    return torch.from_numpy(scaled.transpose(2, 0, 1)[None]).float()


def caffe_conv1(rgb, weight, bias, stride):
    """Convolve as Caffe does, with OpenCV: BGR in 0-255 less the mean, unchanged weights."""
    planes = cv2.split(cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR))
    kernel = weight.shape[-1]
    maps = []
    for filters, shift in zip(weight.astype(np.float64), bias, strict=True):
        total = shift + sum(
            cv2.filter2D(plane - mean, cv2.CV_64F, part, anchor=(0, 0))
            for plane, mean, part in zip(planes, (104.0, 117.0, 123.0), filters, strict=True)
        )
        last = rgb.shape[0] - kernel + 1
        maps.append(total[:last:stride, :last:stride])
    return np.stack(maps)


def assert_conv1_equals_caffe(net, weight, bias, stride):
    rgb = photo()
    expected = caffe_conv1(rgb, weight, bias, stride)
    with torch.no_grad():
        actual = net.trunk.layers.conv1[0](normalised(rgb))[0].numpy()
    assert actual.shape == expected.shape
    assert np.abs(actual - expected).max() < 1e-4 * np.abs(expected).max()


@pytest.mark.parametrize("trunk", ["alexnet_caffe", "tcnn"])
def test_caffe_alexnet(tmp_path, trunk):
    state = fabricate(ALEXNET_CAFFE)
    net = visualnet(trunk, norm="lrn")
    head = [p.clone() for p in net.head.parameters()]
    message = load_trunk_weights(net.trunk, save_npz(tmp_path / "alexnet.npz", state))
    assert f"{trunk} trunk" in message
    weight, bias = state["conv1.weight"].numpy(), state["conv1.bias"].numpy()
    assert_conv1_equals_caffe(net, weight, bias, stride=4)
    assert torch.equal(net.trunk.layers.conv2[0].weight, state["conv2.weight"])
    assert all(torch.equal(a, b) for a, b in zip(head, net.head.parameters(), strict=True))


def test_torchvision_layout_is_copied(tmp_path):
    state = fabricate(ALEXNET_TORCHVISION)
    path = tmp_path / "weights.pth"
    torch.save(state, path)
    net = visualnet()
    message = load_trunk_weights(net.trunk, path)
    assert message == f"alexnet_torchvision trunk from {path} (torchvision layout, 10 tensors)"
    loaded = net.trunk.state_dict()
    assert torch.equal(loaded["layers.conv4.0.weight"], state["features.8.weight"])
    assert torch.equal(loaded["layers.conv4.0.bias"], state["features.8.bias"])


def test_features_are_the_published_ones_divided_by_one_number(tmp_path):
    trunk = "alexnet_torchvision"
    state = fabricate(ALEXNET_TORCHVISION)
    torch.save(state, tmp_path / "weights.pth")
    net, published = visualnet(trunk), visualnet(trunk)
    load_trunk_weights(net.trunk, tmp_path / "weights.pth")
    names = published.trunk.layouts["torchvision"].items()
    kinds = ("weight", "bias")
    published.trunk.load_state_dict(
        {f"{ours}.{kind}": state[f"{theirs}.{kind}"] for theirs, ours in names for kind in kinds}
        | dict(published.trunk.named_buffers())
    )
    torch.manual_seed(0)
    image = torch.randn(1, 3, 224, 224)
    features, expected = net.trunk(image), published.trunk(image)
    factor = expected.norm() / features.norm()
    torch.testing.assert_close(features * factor, expected, rtol=1e-4, atol=1e-4 * factor.item())
    assert 0.5 < features.square().mean().sqrt() < 2


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture
def hub(tmp_path, monkeypatch):
    """A folder of torch.hub of this test's own, and a fabricated official file to fetch."""
    folder = tmp_path / "hub"
    monkeypatch.setattr(torch.hub, "get_dir", lambda: str(folder))
    source = tmp_path / "weights.pth"
    torch.save(fabricate(ALEXNET_TORCHVISION), source)
    official = source.rename(tmp_path / f"alexnet-{sha256(source)[:8]}.pth")
    return folder / "checkpoints", official


@pytest.mark.parametrize("by_address", [False, True])
def test_official_weights_are_fetched_once(hub, monkeypatch, by_address):
    folder, official = hub
    net = visualnet("alexnet_torchvision")
    url = official.as_uri()
    monkeypatch.setattr(type(net.trunk), "imagenet_url", url)
    monkeypatch.setattr(type(net.trunk), "imagenet_sha256", sha256(official))
    source = url if by_address else "imagenet"
    assert str(folder / official.name) in load_trunk_weights(net.trunk, source)
    official.unlink()
    load_trunk_weights(net.trunk, source)
    kept = folder / official.name
    kept.write_bytes(kept.read_bytes()[:-1])
    with pytest.raises(UserError, match=r"not the published file .* delete it to fetch it anew"):
        load_trunk_weights(net.trunk, source)


def test_fetched_file_must_have_the_digest_of_its_name(hub, monkeypatch):
    folder, official = hub
    net = visualnet("alexnet_torchvision")
    monkeypatch.setattr(type(net.trunk), "imagenet_sha256", None)
    altered = official.rename(official.with_name("alexnet-01234567.pth"))
    monkeypatch.setattr(type(net.trunk), "imagenet_url", altered.as_uri())
    with pytest.raises(UserError, match=r"could not fetch .*invalid hash value"):
        load_trunk_weights(net.trunk, "imagenet")
    assert not list(folder.iterdir())


def test_no_network(hub, monkeypatch):
    def refuse(*_args, **_options):
        raise urllib.error.URLError("no route to host")

    monkeypatch.setattr(torch.hub, "download_url_to_file", refuse)
    place = hub[0] / "alexnet-owt-7be5be79.pth"
    with pytest.raises(UserError) as caught:
        load_trunk_weights(visualnet().trunk, "imagenet")
    text = str(caught.value)
    assert "https://download.pytorch.org/models/alexnet-owt-7be5be79.pth" in text
    assert "no route to host" in text
    assert f"put the file at {place} or give weights=PATH." in text


def refused(net, source, *parts):
    before = {name: value.clone() for name, value in net.state_dict().items()}
    with pytest.raises(UserError) as caught:
        load_trunk_weights(net.trunk, source)
    text = str(caught.value)
    assert text.startswith("weights")
    assert all(part in text for part in parts), text
    assert all(torch.equal(value, before[name]) for name, value in net.state_dict().items())


@pytest.mark.parametrize("trunk", ["alexnet_caffe", "tcnn"])
def test_caffe_trunks_have_no_official_file(trunk):
    refused(visualnet(trunk), "imagenet", "weights=imagenet", trunk, "weights=PATH")


def test_other_addresses():
    refused(visualnet(), "https://example.org/alexnet.pth", "not an official file")


def test_missing_file(tmp_path):
    refused(visualnet(), tmp_path / "none.npz", "there is no file", "none.npz")


def test_wrong_suffix(tmp_path):
    path = tmp_path / "weights.h5"
    path.touch()
    refused(visualnet(), path, str(path), ".npz, .caffemodel, .mat, .pth or .pt")


@pytest.mark.parametrize("suffix", [".npz", ".pth"])
@pytest.mark.parametrize("kept", [0.0, 0.01, 0.5, 0.999])
def test_truncated_file(tmp_path, suffix, kept):
    path = tmp_path / f"weights{suffix}"
    state = fabricate({"features.0": (64, 3, 11, 11)})
    if suffix == ".npz":
        save_npz(path, state)
    else:
        torch.save(state, path)
    content = path.read_bytes()
    path.write_bytes(content[: int(kept * len(content))])
    refused(visualnet(TRUNK_OF[suffix]), path, str(path), "cannot be read")


@pytest.mark.parametrize("suffix", [".npz", ".pth", ".pt"])
def test_file_of_something_else(tmp_path, suffix):
    path = tmp_path / f"weights{suffix}"
    path.write_text("<html>not found</html>")
    refused(visualnet(TRUNK_OF[suffix]), path, "cannot be read")


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_damaged_array(tmp_path, save):
    path = tmp_path / "weights.npz"
    save(path, **{"conv1.weight": np.random.default_rng(0).random((96, 3, 11, 11))})
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 0xFF
    path.write_bytes(content)
    refused(visualnet("alexnet_caffe"), path, "cannot be read")


def test_single_array_under_the_name_of_an_archive(tmp_path):
    path = tmp_path / "weights.npz"
    with path.open("wb") as file:
        np.save(file, np.zeros(3))
    refused(visualnet("alexnet_caffe"), path, "cannot be read")


def test_pickled_objects_are_not_run(tmp_path):
    path = tmp_path / "weights.pth"
    torch.save({"features.0.weight": Path("/")}, path)
    refused(visualnet(), path, "cannot be read")


@pytest.mark.parametrize("content", [[1, 2], {"epoch": 3}])
def test_not_a_state_dict(tmp_path, content):
    path = tmp_path / "weights.pt"
    torch.save(content, path)
    refused(visualnet(), path, "state dict")


def test_weights_of_another_network(tmp_path):
    path = save_npz(tmp_path / "alexnet.npz", fabricate(ALEXNET_CAFFE))
    refused(visualnet("vgg_m"), path, "conv1.weight", "(96, 3, 11, 11)", "(96, 3, 7, 7)")


def test_missing_tensor(tmp_path):
    state = fabricate(ALEXNET_CAFFE)
    del state["conv4.bias"]
    path = save_npz(tmp_path / "alexnet.npz", state)
    refused(visualnet("alexnet_caffe"), path, "has no conv4.bias", "alexnet_caffe")


def test_numbers_must_not_overflow(tmp_path):
    state = fabricate(ALEXNET_CAFFE)
    state["conv2.weight"][:] = 3e38
    path = save_npz(tmp_path / "alexnet.npz", state)
    refused(visualnet("tcnn"), path, "is not finite, or huge")


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_must_be_finite(tmp_path, value):
    state = fabricate(ALEXNET_CAFFE)
    state["conv3.bias"][7] = value
    path = save_npz(tmp_path / "alexnet.npz", state)
    refused(visualnet("tcnn"), path, "conv3.bias", "not finite")


@pytest.mark.parametrize(
    ("trunk", "suffix", "use"),
    [
        ("alexnet_torchvision", ".npz", ".pth or .pt"),
        ("tcnn", ".pth", "use .npz, .caffemodel or .mat"),
    ],
)
def test_layout_the_trunk_does_not_have(tmp_path, trunk, suffix, use):
    path = tmp_path / f"weights{suffix}"
    path.touch()
    refused(visualnet(trunk), path, use, trunk)


def test_width_must_be_one():
    refused(visualnet(width=0.5), "imagenet", "model.visual.width=1", "0.5")


def test_batch_normalised_trunk():
    refused(visualnet(norm="batch"), "imagenet", "model.visual.norm=none")
    caffe = visualnet("alexnet_caffe", norm="batch")
    refused(caffe, "imagenet", "model.visual.norm=lrn or none")
