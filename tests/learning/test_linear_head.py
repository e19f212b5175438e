"""FC3 fitted at once to the texture features of whole photos."""

import numpy as np
import torch
from conftest import make_card, trunk_node
from scipy.special import softmax
from sklearn.linear_model import LogisticRegression
from sklearn.model_selection import PredefinedSplit, cross_val_predict

from tex_lightning.config import EngineConfig
from tex_lightning.core.groups import leave_out
from tex_lightning.learning.linear_head import FrozenTrunk, _view, fit_linear_head
from tex_lightning.learning.module import SurfaceModule
from tex_lightning.networks.temperature import fit_temperature
from tex_lightning.perturbations.table import Augmentation

COLOURS = np.array([[190, 150, 150], [150, 190, 150], [150, 150, 190]], np.uint8)
ENGINE = EngineConfig(fast=False, tile=None)
PROBE = {"passes": 1, "side": 300, "strength": 0.03}


class Photos:
    """A bank of photos in memory, and a store that counts what it computes."""

    def __init__(self, photos, augmentation=None):
        self.recordings, self.augmentation, self.store = photos, augmentation, self
        self.kept = {}

    def derived(self, recording, key, compute):
        if (id(recording), key) not in self.kept:
            self.kept[id(recording), key] = compute()
        return self.kept[id(recording), key]

    def photo(self, index):
        return self.recordings[index]


def photos_of(classes, count, seed, size=(240, 290)):
    """A colour of its own for each class, in noise."""
    rng = np.random.default_rng(seed)
    labels = np.arange(count) % classes
    noise = rng.integers(0, 60, (count, *size, 3), dtype=np.uint8)
    return Photos(list(COLOURS[labels][:, None, None] + noise)), labels


def names(count):
    """A group for each photo."""
    return [str(number) for number in range(count)]


def module_of(classes, probe=PROBE, trunk="efficientnet_lite0"):
    names, trunk = [str(number) for number in range(classes)], trunk_node(trunk)
    card = make_card("visual", classes=names, trunk=trunk, width=0.1, norm="none", head=[])
    torch.manual_seed(0)
    fit = {"head_factor": 1.0, "probe": probe}
    return SurfaceModule(card, fit, 0, {"visual": 224})


def scores(module, photo):
    module.eval()
    with torch.no_grad():
        return module.classifier.logits(image=torch.from_numpy(photo))


def test_mean_score_is_that_of_scikit_learn_on_mean_features():
    module = module_of(3)
    photos, labels = photos_of(3, 12, seed=1)
    raw = []
    with torch.no_grad():
        for photo in photos.recordings:
            image = module.classifier.senses["visual"](torch.from_numpy(photo))
            raw.append(module.network.eval().trunk(image).mean(dim=(0, 2, 3)).double().numpy())
    groups = names(12)
    fit_linear_head(module, photos, labels, groups, ENGINE)
    spread = np.sqrt(np.var(raw, axis=0) + 0.1**2)
    rows = (raw - np.mean(raw, axis=0)) / spread
    expected = LogisticRegression(C=0.03, tol=1e-6, max_iter=5000)
    folds = PredefinedSplit(leave_out(labels.tolist(), groups))
    left_out = cross_val_predict(expected, rows, labels, cv=folds, method="decision_function")
    temperature = fit_temperature([torch.from_numpy(each)[:, None] for each in left_out], labels)
    mean = torch.stack([scores(module, each).mean(dim=1) for each in photos.recordings])
    wanted = expected.fit(rows, labels).decision_function(rows) / temperature
    found = mean.softmax(dim=1).numpy()
    np.testing.assert_allclose(found, softmax(wanted, axis=1), atol=4e-3)


def test_large_photos_are_cut_small_ones_mirrored_and_all_of_them_perturbed():
    module = module_of(2)
    photos, _ = photos_of(2, 2, seed=1, size=(180, 700))
    corner, view = _view(photos, 0, 0, module)
    assert view.shape == (180, 300, 3)
    assert np.array_equal(view, _view(photos, 0, 0, module)[1])
    assert corner != _view(photos, 0, 1, module)[0]  # the next pass cuts elsewhere
    darker = Photos(photos.recordings, Augmentation.of(["darkness"], share=1.0))
    assert _view(darker, 0, 0, module)[1].mean() < 0.99 * view.mean()


def test_features_of_a_view_are_computed_once():
    photos, labels = photos_of(2, 4, seed=1)
    module, other = module_of(2, {**PROBE, "passes": 2}), module_of(2)
    fit_linear_head(module, photos, labels, names(4), ENGINE)
    assert len(photos.kept) == 4  # as both passes see the whole photo
    fit_linear_head(other, photos, labels, names(4), ENGINE)
    assert len(photos.kept) == 4
    with torch.no_grad():
        next(other.network.trunk.parameters()).mul_(2)  # another trunk
    fit_linear_head(other, photos, labels, names(4), ENGINE)
    assert len(photos.kept) == 8


def test_the_features_of_another_piece_of_a_photo_are_not_those_in_the_cache():
    trunk = FrozenTrunk(module_of(3).classifier.eval(), "visual")
    photos, _ = photos_of(3, 1, seed=1, size=(300, 340))
    (photo,) = photos.recordings
    views = {(0, 0): photo[:240, :240], (60, 100): photo[60:, 100:], (0, 1): photo[:240, 1:200]}
    for corner, view in views.items():
        found = trunk.kept(view, corner, photo, photos)
        np.testing.assert_array_equal(found, trunk.mean(view))
    assert len(photos.kept) == len(views)
