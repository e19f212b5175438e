import torch

from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.windows import WindowNet, cut_windows
from tex_lightning.tasks.profile import agreement


def test_a_twin_with_other_weights_is_found_out():
    torch.manual_seed(0)
    network = HapticNet(4, width=0.1).eval()
    torch.nn.init.normal_(network.head.scores[1].weight)
    grid = cut_windows(torch.randn(1, 1, 50, 400), network.window_size, network.stride)
    with torch.no_grad():
        assert agreement(network, WindowNet(network), grid) == 1
        other = WindowNet(network)
        other.head[-1].bias.copy_(torch.tensor([1e3, 0, 0, 0]))
        assert agreement(network, other, grid) < 1
