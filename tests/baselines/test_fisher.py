"""Baselines on photos: Fisher vectors against scikit-image, local binary patterns by hand."""

import numpy as np
import pytest
import torch
from conftest import make_photo
from skimage.feature import fisher_vector as published
from sklearn.mixture import GaussianMixture
from sklearn.svm import SVC

from tex_lightning.baselines.fisher import FisherVectors, fisher_vector, fit_planes
from tex_lightning.baselines.patterns import CODES, LocalBinaryPatterns


def baseline(scales=(0.0,), max_side=1024):
    settings = {"components": 3, "photos": 4, "descriptors": 40, "cost": 1.0, "max_side": max_side}
    return FisherVectors(trunk="alexnet_caffe", scales=list(scales), **settings)


@pytest.fixture
def mixture():
    rng = np.random.default_rng(0)
    features = rng.normal(size=(200, 5)) * [1, 2, 3, 1, 1] + rng.integers(0, 3, (200, 1))
    return GaussianMixture(4, covariance_type="diag", random_state=0).fit(features), features


def tensors(mixture):
    arrays = (mixture.weights_, mixture.means_, mixture.covariances_)
    return [torch.from_numpy(array) for array in arrays]


def test_gradients_are_scikit_images(mixture):
    fitted, features = mixture
    ours = fisher_vector(torch.from_numpy(features), *tensors(fitted)).numpy()
    theirs = published(features, fitted)[4:]  # without the gradients towards the weights
    np.testing.assert_allclose(ours[:20], theirs[:20], atol=1e-9)
    np.testing.assert_allclose(ours[20:], -theirs[20:], atol=1e-9)  # theirs has the other sign


def test_planes_are_linear_machines_with_calibrated_scores():
    rng = np.random.default_rng(0)
    labels = np.arange(30) % 3
    vectors = torch.from_numpy(rng.normal(size=(30, 8)) + np.eye(3, 8)[labels]).float()
    planes = fit_planes(vectors, labels, 1.0)
    scores = (vectors @ planes["directions"].T + planes["offsets"]).numpy()
    for label in range(3):
        own = labels == label
        assert np.median(scores[own, label]) == pytest.approx(1, abs=1e-4)
        assert np.median(scores[~own, label]) == pytest.approx(0, abs=1e-4)
        reference = SVC(kernel="linear", C=1.0, tol=1e-5).fit(vectors.numpy(), own)
        distances = reference.decision_function(vectors.numpy())
        assert np.corrcoef(distances, scores[:, label])[0, 1] > 0.9999


@torch.inference_mode()
def test_features_are_the_last_convolution_before_relu():
    system = baseline()
    system.require_weights(0)
    photo = make_photo(0, 0, 64)
    features = system.features(photo)
    image = system.pixels(torch.from_numpy(photo).permute(2, 0, 1)[None])
    layers = system.network.layers
    expected = layers.conv5[0](layers[: list(dict(layers.named_children())).index("conv5")](image))
    assert features.shape[1] == 256
    assert features.min() < 0
    torch.testing.assert_close(features.T, expected[0].flatten(1))


def test_scales_are_bounded_on_both_sides():
    system = baseline(scales=(1.0, 0.0, -1.0, -2.0), max_side=100)
    assert system.factors(64, 64) == [1.0, 0.5]
    assert system.factors(30, 50) == [2.0, 1.0]
    assert system.factors(1000, 1000) == [0.1]
    assert system.min_side == 15


def test_state_round_trip_and_labels():
    photos = [make_photo(kind, number, 96) for kind in range(2) for number in range(4)]
    system = baseline()
    system.fit(photos, np.repeat([0, 1], 4), seed=0)
    other = baseline()
    other.load_state(system.state())
    for photo, label in zip(photos, np.repeat([0, 1], 4), strict=True):
        logits = system.logits(photo)
        assert logits.shape == (2, 1)
        assert logits.argmax() == label
        assert torch.equal(logits, other.logits(photo))
    assert other.count_parameters() == system.count_parameters()


def test_command_line(cli, surfaces, tmp_path):
    outcome = cli(
        "model=alexnet_fv", "data=folder", f"data.root={surfaces}", "data.half_scale=false",
        "debug=tiny", "data.classes=2", f"hydra.run.dir={tmp_path}", "model.baseline.max_side=100",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
    assert "random weights" in outcome.err


def test_quarter_turns_change_nothing():
    system = LocalBinaryPatterns(radii=[1, 2, 4], strength=1.0)
    photo = make_photo(0, 0, 120)
    for turns in (1, 2, 3):
        turned = np.ascontiguousarray(np.rot90(photo, turns))
        np.testing.assert_allclose(system.features(turned), system.features(photo), atol=2e-3)


def test_a_bright_dot_by_hand():
    """Around a dot every pattern is of the eight that see it, or sees no lower neighbour."""
    photo = np.full((9, 9, 3), 100, dtype=np.uint8)
    photo[4, 4] = 200
    shares = LocalBinaryPatterns(radii=[1], strength=1.0).features(photo)
    assert shares.shape == (CODES,)
    assert shares.sum() == pytest.approx(1)
    assert shares[0] == pytest.approx(1 / 49)  # the dot, all of whose neighbours are darker
