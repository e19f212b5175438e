"""``task=profile`` through the command line, and what it measures by."""

import json
import math
import re
import statistics
import sys
from types import ModuleType

import pytest
import torch
from conftest import make_card
from torch import nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.inference.engine import count_macs
from tex_lightning.studies.profile import WindowNet, agreement

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
        assert network["label_agreement"] <= 1
        assert network["recording_agreement"] in (0, 1 / 3, 2 / 3, 1)
        trained, fast = network["reference_ms"], network["fcn_ms"]
        assert network["speedup"] == network["sliding_window_ms"] / trained
        assert network["speedup_same_engine"] == network["same_engine_window_ms"] / fast
        assert network["engine_speedup"] == trained / fast
        assert 1 < network["arithmetic_ratio"] <= network["windows"]
        rate = 2 * network["macs"] / network["fcn_ms"] / 1e6
        assert network["roofline_fraction"] == pytest.approx(rate / network["gemm_gflops"])
    assert results["networks"]["visual"]["windows"] == 4 * 2  # 320x256 pixels, 224 every 32
    page = (tmp_path / "report.html").read_text()
    for key in ("speedup", "label_agreement"):
        cells = [f"<td>{network[key]:,.4g}</td>" for network in results["networks"].values()]
        assert f"<td>{key}</td>{''.join(cells)}" in page
    agree = all(network["label_agreement"] == 1 for network in results["networks"].values())
    assert agree != ("windows are padded at their edges" in page)


def test_a_profiled_checkpoint_has_its_own_name(cli, fused, tmp_path):
    given = f"checkpoint={fused}/checkpoints/haptic.ckpt"
    outcome = cli("task=profile", given, "debug=tiny", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    results = json.loads((tmp_path / "results.json").read_text())
    assert [results["model"], *results["networks"]] == ["haptic", "haptic"]
    assert "profile · haptic · " in outcome.err


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


@torch.no_grad()
def test_the_labels_of_the_dense_pass_are_compared_with_those_of_the_windows():
    torch.manual_seed(0)
    classifier = SurfaceClassifier(make_card("haptic", classes=["a", "b", "c", "d"], width=0.1))
    network = classifier.eval().network
    nn.init.normal_(network.head.score_layer.weight)
    inputs = [torch.randn(1, 1, 50, 2400) for _ in range(3)]
    means = network.features(inputs[0], "fc3").flatten(2)[0].mean(1)
    network.head.score_layer.bias.sub_(means)  # so that every class wins somewhere
    same, votes = [], 0
    for x in inputs:
        dense = network.features(x, "fc3").flatten(2)[0].argmax(0)
        width = network.window_size[1]
        starts = range(0, x.shape[3] - width + 1, network.stride)
        alone = [int(network.features(x[..., i : i + width], "fc3").argmax(1)) for i in starts]
        same += [label == int(whole) for label, whole in zip(alone, dense, strict=False)]
        votes += statistics.mode(alone) == int(dense.mode().values)
    found = agreement(classifier, WindowNet(network), inputs)
    assert found["label_agreement"] == pytest.approx(sum(same) / len(same))
    assert found["label_agreement"] < 1  # padding at the edges of the windows
    assert found["recording_agreement"] == pytest.approx(votes / 3)
    other = WindowNet(network)
    other.head[-1].bias.copy_(torch.tensor([1e3, 0, 0, 0]))
    assert agreement(classifier, other, inputs)["label_agreement"] < found["label_agreement"]


def test_macs_are_those_of_the_textbook():
    network = nn.Sequential(nn.Conv2d(3, 4, 3, padding=1), nn.BatchNorm2d(4), nn.Conv2d(4, 5, 1))
    x = torch.zeros(1, 3, 10, 12)
    assert count_macs(lambda: network.eval()(x)) == 10 * 12 * (4 * 3 * 9 + 5 * 4)
