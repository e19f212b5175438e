"""FusionNet against explicit concatenation and a linear layer."""

import pytest
import torch
from conftest import visualnet

from tex_lightning.networks import FusionNet, HapticNet

CLASSES = 5


def unimodal(norm="none"):
    torch.manual_seed(0)
    haptic = HapticNet(4, width=0.05, norm=norm)
    visual = visualnet(3, trunk="tcnn", width=0.05, norm=norm)
    return haptic, visual


def fusion(level="fc2", norm="none"):
    torch.manual_seed(1)
    return FusionNet(*unimodal(norm), classes=CLASSES, level=level)


def inputs(frames=230, height=235, width=250):
    generator = torch.Generator().manual_seed(2)
    spectrogram = torch.rand(2, 1, 50, frames, generator=generator)
    return spectrogram, torch.randn(2, 3, height, width, generator=generator)


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_pair_scores_equal_concatenation_and_linear(level):
    haptic, visual = (net.eval() for net in unimodal())
    net = fusion(level).eval()
    torch.nn.init.normal_(net.head.weight)
    torch.nn.init.normal_(net.head.bias)
    spectrogram, image = inputs()
    f_haptic = haptic.features(spectrogram, level)
    f_visual = visual.features(image, level)
    length, (rows, columns) = f_haptic.shape[-1], f_visual.shape[-2:]
    assert (length, rows, columns) == (4, 2, 3)
    pairs = torch.cartesian_prod(torch.arange(length), torch.arange(rows * columns))
    scores = net(spectrogram, image, pairs)
    assert scores.shape == (2, CLASSES, len(pairs))
    for index, (i, j) in enumerate(pairs.tolist()):
        row, column = divmod(j, columns)
        both = torch.cat([f_haptic[..., i], f_visual[..., row, column]], dim=1)
        torch.testing.assert_close(scores[..., index], net.head(both))


def test_parts_sum_to_the_scores():
    net = fusion().eval()
    spectrogram, image = inputs()
    haptic, visual = net.parts(spectrogram, image)
    assert haptic.shape == (2, CLASSES, 4)
    assert visual.shape == (2, CLASSES, 6)
    pairs = torch.tensor([[3, 5], [0, 1], [3, 5]])
    scores = net(spectrogram, image, pairs)
    assert torch.equal(scores, haptic[..., [3, 0, 3]] + visual[..., [5, 1, 5]])


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_a_start_from_scores_adds_the_scores_of_both_networks(level):
    torch.manual_seed(0)
    haptic = HapticNet(CLASSES, width=0.05).eval()
    visual = visualnet(CLASSES, trunk="tcnn", width=0.05).eval()
    for score_layer in (haptic.head.score_layer, visual.head.score_layer):
        torch.nn.init.normal_(score_layer.weight)
        torch.nn.init.normal_(score_layer.bias)
    net = FusionNet(haptic, visual, classes=CLASSES, level=level).eval()
    net.start_from_scores(haptic, visual)
    spectrogram, image = inputs()
    pairs = torch.tensor([[3, 5], [0, 1]])
    expected = haptic(spectrogram)[..., [3, 0]] + visual(image).flatten(2)[..., [5, 1]]
    torch.testing.assert_close(net(spectrogram, image, pairs), expected)


def test_single_pair_needs_no_pairs():
    net = fusion().eval()
    spectrogram, image = inputs(192, 224, 224)
    scores = net(spectrogram, image)
    assert scores.shape == (2, CLASSES, 1)
    assert torch.equal(scores, net(spectrogram, image, torch.tensor([[0, 0]])))


@pytest.mark.parametrize("sides", [(193, 224, 224), (192, 231, 224)])
def test_several_pairs_need_pairs(sides):
    with pytest.raises(ValueError, match="pairs is needed"):
        fusion().eval()(*inputs(*sides))


def test_paper_parameter_counts():
    haptic, visual = HapticNet(69, norm="lrn"), visualnet(69, norm="lrn")
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


def test_caller_keeps_its_networks():
    haptic, visual = (net.eval() for net in unimodal())
    spectrogram, image = inputs()
    before = haptic(spectrogram), visual(image)
    net = FusionNet(haptic, visual, classes=CLASSES)
    for parameter in net.parameters():
        torch.nn.init.zeros_(parameter)
    assert torch.equal(haptic(spectrogram), before[0])
    assert torch.equal(visual(image), before[1])


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_state_loads_into_a_fresh_network(level):
    trained = fusion(level, norm="batch").eval()
    torch.manual_seed(9)
    haptic = HapticNet(4, width=0.05)
    visual = visualnet(3, trunk="tcnn", width=0.05)
    fresh = FusionNet(haptic, visual, classes=CLASSES, level=level).eval()
    fresh.load_state_dict(trained.state_dict())
    sample = inputs(192, 224, 224)
    assert torch.equal(fresh(*sample), trained(*sample))


@pytest.mark.parametrize("level", ["fc2", "fc3"])
def test_parameter_groups_are_all_parameters_and_all_learn(level):
    net = fusion(level, norm="batch")
    net(*inputs(192, 224, 224)).square().sum().backward()
    groups = [*net.backbone_parameters(), *net.head_parameters()]
    assert {id(p) for p in groups} == {id(p) for p in net.parameters()}
    assert len(groups) == len({id(p) for p in groups})
    assert len(list(net.head_parameters())) == 2
    assert all(p.grad is not None for p in groups)
