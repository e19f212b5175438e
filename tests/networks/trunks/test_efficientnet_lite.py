"""EfficientNet-Lite against another implementation of it, and its features against its maps."""

import numpy as np
import pytest
import torch
from efficientnet_lite_pytorch import EfficientNet
from torch.nn.functional import conv2d, pad

from tex_lightning.errors import UserError
from tex_lightning.networks.blocks import MEAN, Window
from tex_lightning.networks.trunks import published
from tex_lightning.networks.trunks.efficientnet_lite import (
    STAGES,
    EfficientNetLite0,
    TextureFeatures,
)
from tex_lightning.networks.weights import load_trunk_weights
from tex_lightning.senses.features.image import ImageFeatures

VARIANTS = ["efficientnet_lite0", "efficientnet_lite2"]


def lively(name):
    """The reference of a variant with statistics as training leaves them."""
    torch.manual_seed(0)
    # its padding is that of one size of input, and ours that of even maps
    network = EfficientNet.from_name(name.replace("_", "-"), image_size=224)
    for layer in network.modules():
        if isinstance(layer, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(layer.weight, 0.5, 1.5)
            torch.nn.init.normal_(layer.bias, std=0.5)
            torch.nn.init.normal_(layer.running_mean, std=0.2)
            torch.nn.init.uniform_(layer.running_var, 0.05, 1)
    return network.eval().requires_grad_(False)


@torch.no_grad()
def reference_maps(network, photo):
    """Outputs of all stages for a photo (1, 3, H, W) in 0 to 255 with the package's padding."""
    colour = 255 * torch.tensor(MEAN, dtype=photo.dtype)[:, None, None]
    bordered = pad(photo - colour, (0, 1, 0, 1)) + colour
    x = conv2d((bordered - 127) / 128, network._conv_stem.weight, stride=2)
    x, maps = torch.nn.functional.relu6(network._bn0(x)), []
    for block, after in zip(network._blocks, [*network._blocks[1:], None], strict=True):
        x = block(x)
        ends = after is None or after._block_args.output_filters != block._block_args.output_filters
        maps += [x] if ends else []
    return maps


@torch.no_grad()
def stage_maps(trunk, image):
    maps = []
    for name, layer in list(trunk.layers.named_children())[:-1]:
        image = layer(image)
        maps += [image] if name != "stem" else []
    return maps


def photo(height, width):
    rng = np.random.default_rng(0)
    coarse = torch.from_numpy(rng.integers(0, 256, (1, 3, 9, 9))).float()
    smooth = torch.nn.functional.interpolate(coarse, (height, width), mode="bilinear")
    return smooth.round()


def assert_same_maps(trunk, reference, given):
    trunk, reference = trunk.double().eval(), reference.double()
    expected = reference_maps(reference, given.double())
    found = stage_maps(trunk, ImageFeatures().double()(given.double()))
    assert len(found) == len(expected) == 7
    for ours, theirs in zip(found, expected, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-4, atol=1e-4 * theirs.abs().max().item())


@pytest.mark.parametrize("name", VARIANTS)
def test_a_file_gives_the_maps_of_the_reference(name, tmp_path):
    reference, trunk = lively(name), published(name)
    torch.save(reference.state_dict(), tmp_path / "weights.pth")
    message = load_trunk_weights(trunk, tmp_path / "weights.pth")
    assert message.startswith(f"{name} trunk from")
    assert "(efficientnet layout" in message
    assert_same_maps(trunk, reference, photo(96, 160))


def test_installed_weights_give_the_maps_of_the_reference():
    trunk, reference = published("efficientnet_lite0"), lively("efficientnet_lite0")
    message = load_trunk_weights(trunk, "imagenet")
    path = message.partition(" from ")[2].partition(" (")[0]
    reference.load_state_dict(torch.load(path, weights_only=True))
    assert_same_maps(trunk, reference, photo(224, 192))


CASES = [(224, 7, (224, 255)), (224, 7, (300, 341)), (112, 3, (130, 150)), (64, 2, (97, 64))]


@pytest.mark.parametrize(("patch", "window", "size"), CASES)
def test_every_feature_is_a_mean_over_its_window(patch, window, size):
    torch.manual_seed(0)
    trunk = EfficientNetLite0(width=0.1, norm="batch", patch=patch).eval()
    image = torch.randn(1, 3, *size)
    with torch.no_grad():
        features = trunk(image)[0]
    maps = stage_maps(trunk, image)
    assert features.shape == (trunk.out_channels, *map(trunk.output_side, size))
    for row, column in np.ndindex(*features.shape[1:]):
        places = (
            each[0, :, row * s.positions :, column * s.positions :][
                :, : window * s.positions, : window * s.positions
            ]
            for each, s in zip(maps, STAGES, strict=True)
        )
        expected = torch.cat([each.mean(dim=(1, 2)) for each in places])
        torch.testing.assert_close(features[:, row, column], expected, rtol=1e-4, atol=1e-5)


def test_a_fragment_smaller_than_a_position_is_refused():
    with pytest.raises(UserError, match="choose 32 pixels or more"):
        EfficientNetLite0(width=0.1, norm="none", patch=31)
    assert EfficientNetLite0(width=0.1, norm="none", patch=32).smallest_side(1) == 32


def test_standardised_features_have_mean_zero_and_unit_length():
    torch.manual_seed(0)
    features = TextureFeatures(Window(13, 2), 50)
    rows = 3 + 5 * torch.rand(400, 50)
    standardised = features.standardise(rows)
    torch.testing.assert_close(standardised.mean(dim=0), torch.zeros(50), atol=1e-5, rtol=0)
    assert standardised.square().sum(dim=1).mean() == pytest.approx(1, abs=0.02)
    maps = features([rows[:3, :, None, None]])
    torch.testing.assert_close(maps[..., 0, 0], standardised[:3])
