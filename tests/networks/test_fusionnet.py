"""FusionNet against explicit concatenation and a linear layer."""

import pytest
import torch
from conftest import visualnet

from tex_lightning.networks import FusionNet, HapticNet
from tex_lightning.networks.blocks import score_layer_of
from tex_lightning.networks.fusionnet import bounded

CLASSES = 5


class OwnNet(torch.nn.Module):
    """A user's, of whom nothing is known but that it gives features; they are its scores."""

    def __init__(self, classes):
        super().__init__()
        self.layer = torch.nn.Conv1d(2, classes, 5, stride=3)

    def features(self, x, level):
        assert level == "fc3"
        return self.layer(x)


def inputs(frames=230, height=235, width=250):
    generator = torch.Generator().manual_seed(2)
    spectrogram = torch.rand(2, 1, 50, frames, generator=generator)
    return spectrogram, torch.randn(2, 3, height, width, generator=generator)


def test_paper_parameter_counts():
    haptic, visual = HapticNet(69, width=1.0, norm="lrn"), visualnet(69, norm="lrn")
    unused = 2 * (250 * 69 + 69)
    count = {
        level: sum(
            p.numel() for p in FusionNet(haptic, visual, classes=69, level=level).parameters()
        )
        for level in ("fc2", "fc3")
    }
    both = 4_408_919 + 5_191_749
    assert count["fc2"] == both - unused + (250 + 250) * 69 + 69
    assert count["fc3"] == both + (69 + 69) * 69 + 69


def senses(count):
    """So many networks for CLASSES, with their inputs."""
    torch.manual_seed(3)
    visual = visualnet(CLASSES, trunk="tcnn", width=0.05, norm="none")
    networks = HapticNet(CLASSES, width=0.05, norm="none"), visual, OwnNet(CLASSES)
    return [net.eval() for net in networks][:count], (*inputs(), torch.randn(2, 2, 14))[:count]


def several(count, level):
    """A FusionNet of so many networks, their inputs and the features that it fuses."""
    networks, given = senses(count)
    net = FusionNet(*networks, classes=CLASSES, level=level).eval()
    torch.nn.init.normal_(net.head.weight)
    torch.nn.init.normal_(net.head.bias)
    levels = (level, level, "fc3")
    features = [
        network.features(x, own).flatten(2)
        for network, x, own in zip(networks, given, levels, strict=False)
    ]
    return net, given, features


@pytest.mark.parametrize("level", ["fc2", "fc3"])
@pytest.mark.parametrize("count", [1, 2, 3])
def test_parts_of_any_number_of_senses_sum_to_one_linear_layer(count, level):
    net, given, features = several(count, level)
    assert net.sizes == [each.shape[1] for each in features]
    assert net.levels == [level, level, "fc3"][:count]  # the user's has no hidden layer to fuse
    assert [each.shape[-1] for each in features] == [4, 6, 4][:count]
    tuples = torch.tensor([[0, 0, 0], [3, 5, 1], [2, 1, 3], [3, 0, 0]])[:, :count]
    chosen = [each[..., tuples[:, place]] for place, each in enumerate(features)]
    expected = net.head(torch.cat(chosen, dim=1).mT).mT
    torch.testing.assert_close(net(*given, tuples=tuples), expected)
    torch.testing.assert_close(net.fuse(net.parts(*given), tuples), expected)


@pytest.mark.parametrize("indices", [[0], [2], [1, 2], [0, 1], [2, 1, 0]])
def test_a_layer_of_some_senses_adds_what_they_add_to_the_whole(indices):
    net, _, features = several(3, "fc2")
    layer = net.of(indices)
    assert layer.levels == [net.levels[index] for index in indices]
    chosen = [features[index][..., :1] for index in indices]
    found = sum(layer.project(*part) for part in enumerate(chosen))
    expected = sum(net.project(*part) for part in zip(indices, chosen, strict=True))
    torch.testing.assert_close(found, expected)


def test_a_start_from_scores_adds_those_of_three_networks():
    networks, given = senses(3)
    net = FusionNet(*networks, classes=CLASSES, level="fc2").eval()
    net.start_from_scores(*networks)
    tuples = torch.tensor([[3, 5, 2], [0, 1, 3]])
    scores = [
        network.features(x, "fc3").flatten(2) for network, x in zip(networks, given, strict=True)
    ]
    expected = sum(each[..., tuples[:, place]] for place, each in enumerate(scores))
    torch.testing.assert_close(net(*given, tuples=tuples), expected)


def test_tuples_of_three_senses_are_needed_unless_all_have_one_position():
    networks, _ = senses(3)
    net = FusionNet(*networks, classes=CLASSES).eval()
    single = *inputs(192, 224, 224), torch.randn(2, 2, 5)
    assert net(*single).shape == (2, CLASSES, 1)
    with pytest.raises(ValueError, match="1 and 1 and 2 positions"):
        net(*single[:2], torch.randn(2, 2, 8))


@pytest.mark.parametrize(
    "layer", [torch.nn.Conv1d(2, CLASSES, 1, bias=False), torch.nn.Conv1d(2, CLASSES, 3)]
)
def test_a_score_layer_of_another_form_is_fused_on_the_scores(layer):
    own = OwnNet(CLASSES)
    own.score_layer = layer
    fused = FusionNet(HapticNet(4, width=0.05), own, classes=CLASSES, level="fc2")
    assert fused.levels == ["fc2", "fc3"]
    assert fused.sizes[1] == CLASSES
    assert score_layer_of(own) is None
    own.score_layer = torch.nn.Conv1d(2, CLASSES, 1)
    assert score_layer_of(own) is own.score_layer


def test_a_sense_outvotes_none_that_errs_less():
    sure, erring = torch.tensor([[9.0, 11.0], [0.0, 0.0], [0.0, 0.0]]), torch.tensor(0.1)
    found = bounded(sure, erring)
    torch.testing.assert_close(found.diff(dim=1), sure.diff(dim=1))
    probabilities = found.mean(dim=1).softmax(dim=0)
    torch.testing.assert_close(
        probabilities, torch.tensor([0.9, 0, 0]) + 0.1 / 3, atol=1e-3, rtol=0
    )
    other = bounded(sure.roll(1, dims=0), torch.tensor(0.05))
    assert (found + other).mean(dim=1).argmax() == 1
