"""``task=profile`` through the command line, and what it measures by."""

import json
import math
import re
import sys
from types import ModuleType

import pytest
import torch
from torch import nn

from tex_lightning.inference.engine import count_macs
from tex_lightning.networks.hapticnet import HapticNet
from tex_lightning.studies.profile import (
    WindowNet,
    agreement,
    cut_windows,
)

CONTRACT = {
    "fcn_ms", "sliding_window_ms", "speedup", "speedup_same_engine", "engine_speedup",
    "arithmetic_ratio", "windows", "label_agreement", "macs", "gemm_gflops", "roofline_fraction",
}  # fmt: skip


def test_profile_of_both_networks(cli, tmp_path):
    outcome = cli("task=profile", "model=fusion", "debug=tiny", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    assert outcome.out == ""
    assert re.search(r"speedup_same_engine +\d", outcome.err)
    results = json.loads((tmp_path / "results.json").read_text())
    assert {"task", "model", "seed", "wall_seconds", "environment", "engine"} <= set(results)
    assert results["weights"] == "random weights"
    assert set(results["networks"]) == {"haptic", "visual"}
    for network in results["networks"].values():
        assert set(network) >= CONTRACT
        assert all(math.isfinite(network[key]) and network[key] > 0 for key in CONTRACT)
        assert network["label_agreement"] == 1
        trained, fast = network["reference_ms"], network["fcn_ms"]
        assert network["speedup"] == network["sliding_window_ms"] / trained
        assert network["speedup_same_engine"] == network["same_engine_window_ms"] / fast
        assert network["engine_speedup"] == trained / fast
        assert 1 < network["arithmetic_ratio"] <= network["windows"]
        rate = 2 * network["macs"] / network["fcn_ms"] / 1e6
        assert network["roofline_fraction"] == pytest.approx(rate / network["gemm_gflops"])
    assert results["networks"]["visual"]["windows"] == 4 * 2  # 320x256 pixels, 224 every 32


class Plain(nn.Module):
    """A network of one's own that does not say its geometry."""

    def __init__(self, classes):
        super().__init__()
        self.layer = nn.Conv2d(1, classes, (50, 3))

    def features(self, x, level):
        return self.layer(x).squeeze(2)


def test_the_geometry_of_a_network_of_ones_own_is_found(cli, tmp_path, monkeypatch):
    module = ModuleType("plain_network")
    module.Plain = Plain
    monkeypatch.setitem(sys.modules, "plain_network", module)
    network = "model.haptic.network={_target_: plain_network.Plain}"
    run = f"hydra.run.dir={tmp_path}/run"
    outcome = cli("task=profile", "model=haptic", network, "debug=tiny", run)
    assert outcome.status == 0, outcome.err
    profile = json.loads((tmp_path / "run" / "results.json").read_text())["networks"]["haptic"]
    assert profile["windows"] > 1
    assert profile["label_agreement"] == 1


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


def test_macs_are_those_of_the_textbook():
    network = nn.Sequential(nn.Conv2d(3, 4, 3, padding=1), nn.BatchNorm2d(4), nn.Conv2d(4, 5, 1))
    x = torch.zeros(1, 3, 10, 12)
    assert count_macs(lambda: network.eval()(x)) == 10 * 12 * (4 * 3 * 9 + 5 * 4)
