import torch

from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.networks.windows import WindowNet, cut_windows
from tex_lightning.studies.profile import agreement, flips


def test_a_twin_with_other_weights_is_found_out():
    torch.manual_seed(0)
    network = HapticNet(4, width=0.1).eval()
    torch.nn.init.normal_(network.head.scores[1].weight)
    x = torch.randn(1, 1, 50, 400)
    grid = cut_windows(x, network.window_size, network.stride)
    with torch.no_grad():
        assert agreement(network, WindowNet(network), x, grid)["label_agreement"] == 1
        other = WindowNet(network)
        other.head[-1].bias.copy_(torch.tensor([1e3, 0, 0, 0]))
        always_first = agreement(network, other, x, grid)
        dense = network(x).argmax(1)[0, : grid.shape[1]]
    assert always_first["label_agreement"] < 1
    assert always_first["dense_agreement"] == float((dense == 0).double().mean())


def test_flips_are_counted_over_positions_and_for_the_vote():
    exact = torch.tensor([[2.0, 2.0, 0.0], [1.0, 1.0, 1.0]])  # labels 0 0 1
    rough = torch.tensor([[2.0, 0.0, 0.0], [1.0, 1.0, 1.0]])  # labels 0 1 1
    assert flips(exact, rough, "x") == {"positions": 3, "flips_x": 1, "vote_flips_x": True}
    assert flips(exact, exact, "x") == {"positions": 3, "flips_x": 0, "vote_flips_x": False}
