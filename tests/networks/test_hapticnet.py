"""HapticNet against the paper's table and its own windows."""

import torch

from tex_lightning.networks import HapticNet
from tex_lightning.networks.geometry import layer_windows, receptive_field

NARROW = 0.04


def parameters(net):
    return sum(p.numel() for p in net.parameters())


def test_paper_parameter_count():
    # The table's weights and biases, layer by layer: inputs * kernel * outputs + outputs.
    convolutions = [(1, 9, 50), (50, 9, 100), (100, 9, 150), (150, 9, 200), (200, 48, 400)]
    dense = [(400, 1, 250), (250, 1, 69)]
    table = sum(i * k * o + o for i, k, o in convolutions + dense)
    assert parameters(HapticNet(69, width=1.0, norm="lrn")) == table == 4_408_919


def test_every_length_matches_the_forward_pass():
    net = HapticNet(2, width=NARROW).eval()
    for frames in range(net.min_size[1], net.min_size[1] + 40):
        assert (1, net(torch.zeros(1, 1, 50, frames)).shape[-1]) == net.output_size(50, frames)


def test_single_output_range():
    net = HapticNet(2, width=NARROW)
    single = [frames for frames in range(1, 400) if net.output_size(50, frames) == (1, 1)]
    assert (net.min_size, net.window_size) == ((50, 177), (50, 192))
    assert single == list(range(177, 193))
    assert net.output_size(50, 176) == net.output_size(50, 5) == (1, 0)
    assert net.output_size(50, 1600 + net.stride)[1] == net.output_size(50, 1600)[1] + 1


def test_receptive_field_by_impulses():
    net = HapticNet(1, width=0.001, norm="none").double().eval()
    for parameter in net.parameters():
        torch.nn.init.constant_(parameter, 0.5)
    frames = 320
    impulses = torch.eye(frames, dtype=torch.float64)[:, None, None, :].expand(-1, 1, 50, -1)
    with torch.no_grad():
        change = net(impulses) - net(torch.zeros_like(impulses[:1]))
    seen = change[:, 0, 3].abs().nonzero().flatten()
    assert len(seen) == seen[-1] - seen[0] + 1 == receptive_field(layer_windows(net, 1)) == 222
    assert seen[0] == 3 * net.stride - 15
