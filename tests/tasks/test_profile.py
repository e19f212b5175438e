"""``task=profile`` through the command line: both networks at random, and trained parts."""

import csv
import json
import math
from pathlib import Path

import pytest
import torch
from conftest import make_card, trunk_node

from tex_lightning.classifier.classifier import SurfaceClassifier

CONTRACT = {
    "fcn_ms",
    "sliding_window_ms",
    "speedup",
    "speedup_same_engine",
    "engine_speedup",
    "arithmetic_ratio",
    "windows",
    "label_agreement",
    "macs",
    "gemm_gflops",
    "roofline_fraction",
}


@pytest.fixture(scope="module")
def directory(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("profile")


def results(directory: Path) -> dict:
    return json.loads((directory / "results.json").read_text())


def test_profile_of_both_networks(cli, directory):
    outcome = cli(
        "task=profile",
        "model=fusion",
        "debug=tiny",
        f"hydra.run.dir={directory}",
    )
    assert outcome.status == 0, outcome.err
    assert outcome.out == ""
    for words in ("speedup over windows", "195.4", "7903.4"):
        assert words in outcome.err


def test_every_figure_of_the_contract_is_there_and_sane(directory):
    found = results(directory)
    assert {"task", "model", "seed", "wall_seconds", "environment", "engine"} <= set(found)
    assert found["weights"] == "random weights"
    assert set(found["networks"]) == {"haptic", "visual"}
    for network in found["networks"].values():
        assert set(network) >= CONTRACT
        assert all(math.isfinite(network[key]) and network[key] > 0 for key in CONTRACT)
        assert network["label_agreement"] == 1
        assert network["flips_engine"] == 0
        trained, fast = network["reference_ms"], network["fcn_ms"]
        assert network["speedup"] == network["sliding_window_ms"] / trained
        assert network["speedup_same_engine"] == network["same_engine_window_ms"] / fast
        assert network["engine_speedup"] == trained / fast
        assert network["sliding_window_ms"] <= network["sliding_window_p95_ms"]
        windows = network["windows"]
        assert network["arithmetic_ratio"] == windows * network["window_macs"] / network["macs"]
        assert 1 < network["arithmetic_ratio"] <= windows
        rate = 2 * network["macs"] / network["fcn_ms"] / 1e6
        assert network["roofline_fraction"] == pytest.approx(rate / network["gemm_gflops"])
    assert found["networks"]["visual"]["windows"] == 4 * 2  # 320x256 pixels, 224 every 32


def test_figures_and_events_are_left_in_the_run_folder(directory):
    for name in ("haptic", "visual"):
        assert list((directory / "tensorboard" / name).glob("events*"))


@pytest.fixture(params=["fc2", "fc3"])
def fusion(request) -> SurfaceClassifier:
    torch.manual_seed(0)
    card = make_card("haptic", "visual", level=request.param, width=0.1, trunk=trunk_node("tcnn"))
    classifier = SurfaceClassifier(card).eval()
    torch.nn.init.normal_(classifier.fusion.head.weight)
    torch.nn.init.normal_(classifier.fusion.head.bias)
    classifier.senses["haptic"].features.channel_mean.fill_(0.5)
    return classifier


def test_the_parts_of_a_fusion_are_its_halves(fusion):
    haptic, visual = (fusion.with_senses([name]) for name in fusion.card.sense_names)
    assert (haptic.card.kind, visual.card.kind) == ("haptic", "visual")
    assert haptic.senses["haptic"].features.channel_mean[0] == 0.5
    spectrogram, image = torch.randn(1, 1, 50, 210), torch.randn(1, 3, 224, 240)
    with torch.no_grad():
        layer, inputs = fusion.fusion, (spectrogram, image)
        networks = [sense.network for sense in fusion.senses.values()]
        pairs = zip(networks, inputs, strict=True)
        features = [net.features(x, layer.level).flatten(2) for net, x in pairs]
        whole = [layer.project(index, each) for index, each in enumerate(features)]
        parts = haptic.network(spectrogram), visual.network(image).flatten(2)
        if layer.level == "fc3":
            weights = layer.head.weight.tensor_split(2, dim=1)
            parts = weights[0] @ parts[0], weights[1] @ parts[1] + layer.head.bias[:, None]
    for half, part in zip(whole, parts, strict=True):
        torch.testing.assert_close(half, part, rtol=1e-4, atol=1e-5)


@pytest.mark.slow
def test_a_trained_network_is_profiled_on_a_real_file(cli, surfaces, tmp_path):
    fit = ["model=haptic", "data=folder", f"data.root={surfaces}", "debug=tiny"]
    assert cli(*fit, f"hydra.run.dir={tmp_path}/fit").status == 0
    checkpoint = f"checkpoint={tmp_path}/fit/checkpoints/haptic.ckpt"
    wav = surfaces / "alpha" / "haptic" / "alpha_0.wav"
    common = ["task=profile", checkpoint, "debug=tiny"]
    outcome = cli(*common, f"haptic={wav}", f"hydra.run.dir={tmp_path}/profile")
    assert outcome.status == 0, outcome.err
    found = results(tmp_path / "profile")
    assert found["weights"].endswith("haptic.ckpt")
    (network,) = found["networks"].values()
    assert network["input"] == [1, 1, 50, 236]  # 2.4 s
    assert network["windows"] == 3
    assert network["label_agreement"] == 1
    for arguments, message in (
        ([f"image={wav}"], "for a network that is not profiled"),
        ([f"haptic=[{wav},{wav}]"], "takes one file"),
    ):
        refused = cli(*common, *arguments, f"hydra.run.dir={tmp_path}/no")
        assert refused.status == 2
        assert message in refused.err


@pytest.mark.slow
def test_a_sense_that_the_paper_does_not_have_is_profiled_at_its_own_rate(cli, tmp_path):
    outcome = cli("task=profile", "model=sound", "debug=tiny", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    assert "paper: its average" not in outcome.err
    (network,) = results(tmp_path)["networks"].values()
    frames = network["input"][3]
    assert frames == pytest.approx(100 * 3.6, abs=10)  # a frame every 10 ms, also at 44.1 kHz


OWN = """
from torch import nn


class Plain(nn.Module):
    def __init__(self, classes):
        super().__init__()
        self.layer = nn.Conv2d(1, classes, (50, 3))

    def features(self, x, level):
        return self.layer(x).squeeze(2)
"""


def test_the_geometry_of_a_network_of_ones_own_is_found(cli, tmp_path, monkeypatch):
    (tmp_path / "plain_network.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    own = "model.haptic.network={_target_: plain_network.Plain}"
    outcome = cli(
        "task=profile", "model=haptic", own, "debug=tiny", f"hydra.run.dir={tmp_path}/run"
    )
    assert outcome.status == 0, outcome.err
    profile = json.loads((tmp_path / "run" / "results.json").read_text())["networks"]["haptic"]
    assert profile["windows"] > 1
    assert profile["label_agreement"] == 1


@pytest.mark.slow
def test_a_sweep_of_profiles_ends_with_its_summary(cli, tmp_path):
    outcome = cli(
        "-m",
        "task=profile",
        "model=haptic",
        "debug=tiny",
        "seed=0",
        f"hydra.sweep.dir={tmp_path}",
    )
    assert outcome.status == 0, outcome.err
    with (tmp_path / "sweep.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["status"] for row in rows] == ["done"]
