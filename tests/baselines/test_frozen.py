"""Frozen features against a forward pass of the trunk itself, and what weights do."""

import json

import numpy as np
import pytest
import torch
from conftest import make_photo

from tex_lightning.baselines.frozen import FrozenLinear
from tex_lightning.errors import UserError
from tex_lightning.features.image import ImageFeatures


def baseline(**changes):
    settings = {
        "trunk": "squeezenet", "max_side": 1024, "layers": ["fire8", "fire9"],
        "statistics": ["mean", "max", "std"], "strengths": [0.01, 0.1],
    }  # fmt: skip
    return FrozenLinear(**{**settings, **changes})


def test_features_are_statistics_of_the_trunks_own_pass():
    system = baseline()
    system.require_weights(0)
    photo = make_photo(1, 0, 240)
    layers = system.network.layers
    pixels = ImageFeatures()(torch.from_numpy(photo).permute(2, 0, 1)[None]).contiguous()
    inner = layers[: list(dict(layers.named_children())).index("fire9") + 1]
    last = inner(pixels)[0].numpy()
    features = system.features(photo)
    assert features.shape == (2 * 3 * 512,)
    expected = np.concatenate([f(last, axis=(1, 2)) for f in (np.mean, np.max, np.std)])
    np.testing.assert_allclose(features[3 * 512 :], expected, rtol=1e-3, atol=1e-5)


def test_large_photos_are_made_smaller():
    system, whole = baseline(max_side=80), baseline()
    system.require_weights(0)
    whole.frozen = system.frozen
    photo = make_photo(0, 0, 160)
    assert not np.allclose(system.features(photo), whole.features(photo))
    assert np.array_equal(system.features(photo[:80, :80]), whole.features(photo[:80, :80]))


def test_state_round_trip_and_labels():
    photos = [make_photo(kind, number, 96) for kind in range(2) for number in range(4)]
    labels = np.repeat([0, 1], 4)
    system, other = baseline(), baseline()
    system.fit(photos, labels, seed=0)
    other.load_state(system.state())
    for photo, label in zip(photos, labels, strict=True):
        assert system.logits(photo).argmax() == label
        assert torch.equal(system.logits(photo), other.logits(photo))
    assert other.count_parameters() == system.count_parameters()


def test_one_photo_of_a_class_is_enough():
    system = baseline()
    system.fit([make_photo(kind, 0, 64) for kind in range(2)], np.array([0, 1]), seed=0)
    assert system.estimator[-1].C == 0.1


def test_budget_leaves_one_strength():
    assert baseline().with_budget(0.01).strengths == [0.01]


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"layers": ["fire10"]}, "layers.*fire9"),
        ({"layers": ["features"]}, "layers"),
        ({"statistics": []}, "statistics.*mean"),
        ({"strengths": [0.0]}, "strengths"),
    ],
)
def test_wrong_settings(changes, named):
    with pytest.raises(UserError, match=rf"model\.baseline\.{named}"):
        baseline(**changes)


def run(cli, surfaces, *more):
    return cli(
        "model=squeezenet_linear", "data=folder", f"data.root={surfaces}",
        "data.half_scale=false", "debug=tiny", *more,
    )  # fmt: skip


def test_command_line_without_weights(cli, surfaces, tmp_path):
    outcome = run(cli, surfaces, f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    assert "random weights" in outcome.err
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["networks"]["visual"]["macs_per_sample"] > 0


def test_weights_go_into_the_checkpoint(cli, surfaces, shared, tmp_path):
    source = shared / "weights" / "squeezenet_v1.0_imagenet.npz"
    outcome = run(cli, surfaces, f"weights={source}", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 0, outcome.err
    assert "random weights" not in outcome.err
    content = torch.load(tmp_path / "checkpoints" / "visual.ckpt", weights_only=True)
    assert content["hyper_parameters"]["card"]["baseline"]["weights"] == str(source)
    stored = content["baseline"]["trunk.layers.fire5.squeeze.0.weight"].numpy()
    with np.load(source) as raw:
        np.testing.assert_array_equal(stored, raw["fire5__conv1x1_1.weight"])


def test_weights_are_checked_before_any_work(cli, surfaces, tmp_path):
    outcome = run(cli, surfaces, "weights=/no/x.npz", f"hydra.run.dir={tmp_path}")
    assert outcome.status == 2
    assert "/no/x.npz" in outcome.err
    outcome = cli("model=lbp", "weights=/no/x.npz", "data=folder", f"data.root={surfaces}")
    assert outcome.status == 2
    assert "weights belong to a trunk, which model=lbp does not have" in outcome.err
