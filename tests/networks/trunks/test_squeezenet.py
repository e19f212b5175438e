"""Texture features of several layers against what they are by definition."""

import pytest
import torch
from conftest import visualnet

from tex_lightning.errors import UserError
from tex_lightning.networks.trunks.squeezenet import TEXTURES, SqueezeNetTrunk
from tex_lightning.networks.visualnet import VisualNet


def maps_of(trunk, image):
    maps = {}
    for name, layer in list(trunk.layers.named_children())[:-1]:
        image = layer(image)
        maps[name] = image
    return {name: maps[name] for name in TEXTURES}


SIZES = [(213, 224), (224, 244), (230, 309), (245, 277), (300, 341)]
CASES = [(224, 13, 2, size) for size in SIZES] + [(112, 6, 1, (112, 150)), (64, 3, 1, (90, 71))]


@pytest.mark.parametrize(("patch", "window", "step", "size"), CASES)
def test_every_feature_is_a_mean_root_over_its_window(patch, window, step, size):
    torch.manual_seed(0)
    trunk = SqueezeNetTrunk(width=0.1, norm="none", patch=patch).eval()
    with torch.no_grad():
        image = torch.randn(1, 3, *size)
        features = trunk(image)[0]
        maps = maps_of(trunk, image)
    assert features.shape == (trunk.out_channels, *map(trunk.output_side, size))
    for row in range(features.shape[1]):
        for column in range(features.shape[2]):
            expected = torch.cat([
                maps[name][0, :, step * row * k : (step * row + window) * k, step * column * k :][
                    :, :, : window * k
                ].clamp(min=1e-4).sqrt().mean(dim=(1, 2))
                for name, k in TEXTURES.items()
            ])  # fmt: skip
            torch.testing.assert_close(features[:, row, column], expected, rtol=1e-4, atol=1e-5)


def test_only_texture_features_are_scored_as_they_are():
    assert visualnet(3, trunk="squeezenet", head=[]).hidden == 3304
    with pytest.raises(UserError, match="give channels of FC1 and FC2"):
        visualnet(3, trunk="alexnet_caffe", head=[])


def test_a_fragment_of_half_the_side_gives_as_many_predictions_on_a_halved_photo():
    whole = visualnet(3, trunk="squeezenet", head=[], width=0.1)
    half = VisualNet(3, SqueezeNetTrunk(width=0.1, norm="batch", patch=112), head=[])
    assert half.window_size == (112, 112)
    assert 2 * half.stride == whole.stride
    assert half.output_size(112, 112) == (1, 1)
    assert half.output_size(612, 816) == whole.output_size(1224, 1632)


def test_a_fragment_smaller_than_a_position_is_refused():
    with pytest.raises(UserError, match="choose 21 pixels or more"):
        SqueezeNetTrunk(width=0.1, norm="none", patch=20)
    assert SqueezeNetTrunk(width=0.1, norm="none", patch=21).min_side == 21
