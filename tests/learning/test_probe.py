"""Training of VisualNet's head on fixed features of a pretrained trunk."""

import json
from collections import OrderedDict
from itertools import count

import numpy as np
import pytest
import torch
from conftest import make_card, trunk_node, visualnet
from torch import nn

from tex_lightning.learning.base import SurfaceModule
from tex_lightning.learning.visual_head import _fold_standardisation, probe_head

COLOURS = torch.tensor([[200, 40, 40], [40, 200, 40], [40, 40, 200]], dtype=torch.uint8)


def batch(step: int):
    generator = torch.Generator().manual_seed(step)
    label = torch.randint(3, (6,), generator=generator)
    noise = torch.randint(0, 40, (6, 3, 224, 224), generator=generator, dtype=torch.uint8)
    crop = COLOURS[label][:, :, None, None] + noise
    return {"visual": {"crop": crop, "degrees": torch.zeros(6)}, "label": label}


def visual_module(norm: str = "none") -> SurfaceModule:
    card = make_card("visual", trunk=trunk_node("tcnn"), width=0.1, norm=norm, dropout=0.2)
    probe = {"steps": 60, "passes": 1, "batch_size": 8, "learning_rate": 1e-2}
    fit = {"label_smoothing": 0.0, "head_factor": 1.0, "probe": probe}
    torch.manual_seed(0)
    return SurfaceModule(card, fit, 0, {"visual": 224})


@pytest.mark.parametrize("norm", ["none", "batch"])
def test_the_head_learns_and_the_trunk_stays(norm):
    module = visual_module(norm)
    trunk = {key: value.clone() for key, value in module.network.trunk.state_dict().items()}
    probe_head(module, map(batch, count()), 8, seed=0)
    assert all(
        torch.equal(trunk[key], value) for key, value in module.network.trunk.state_dict().items()
    )
    module.eval()
    unseen = batch(99)
    with torch.no_grad():
        logits = module.network(*module.inputs(unseen)).mean(dim=(2, 3))
    assert torch.equal(logits.argmax(dim=1), unseen["label"])


@pytest.mark.parametrize("norm", ["none", "batch"])
def test_folding_equals_standardised_features(norm):
    """On training statistics; under batch normalisation the shift is subtracted there."""
    torch.manual_seed(0)
    network = visualnet(3, trunk="tcnn", width=0.1, norm=norm, dropout=0.0).train()
    features = 5 * torch.rand(16, network.trunk.out_channels, 6, 6) ** 3
    mean, std = (
        statistic(features, dim=(0, 2, 3), keepdim=True) for statistic in (torch.mean, torch.std)
    )
    expected = network.head((features - mean) / std)
    _fold_standardisation(network, mean, std)
    torch.testing.assert_close(network.head(features), expected, rtol=1e-4, atol=1e-5)


def test_pretrained_weights_from_the_command_line(cli, surfaces, tmp_path):
    torch.manual_seed(0)
    layers = [(96, 3, 11), (256, 48, 5), (384, 256, 3), (384, 192, 3), (256, 192, 3)]
    state = OrderedDict()
    for place, (outputs, inputs, kernel) in enumerate(layers, 1):
        conv = nn.Conv2d(inputs, outputs, kernel)
        state[f"conv{place}.weight"], state[f"conv{place}.bias"] = conv.parameters()
    arrays = {key: value.detach().numpy() for key, value in state.items()}
    np.savez(tmp_path / "weights.npz", **arrays)
    outcome = cli(
        "model=visual",
        "model.visual.width=1",
        "model.visual.norm=none",
        f"weights={tmp_path / 'weights.npz'}",
        "model.visual.fit.probe.steps=5",
        "data=folder",
        f"data.root={surfaces}",
        "data.half_scale=false",
        "debug=tiny",
        "trainer.threads=1",
        f"hydra.run.dir={tmp_path / 'run'}",
    )
    assert outcome.status == 0, outcome.err
    entry = json.loads((tmp_path / "run" / "results.json").read_text())["networks"]["visual"]
    assert entry["test_samples"] == 3
