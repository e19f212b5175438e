"""Statistics of the training recordings' features, kept in the checkpoint."""

from pathlib import Path

import numpy as np
import pytest
import torch
from conftest import CLASSES, make_card, make_trace
from scipy.stats import binomtest
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from torch.nn.utils.parametrizations import weight_norm

import tex_lightning as tl
from tex_lightning.classifier.card import novelty_threshold
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.data.recordings import Recording
from tex_lightning.learning.finish import leave_out_each, refit_scores


def traces(kind, numbers):
    return [torch.from_numpy(make_trace(kind, number))[None] for number in numbers]


def test_a_checkpoint_keeps_the_means_of_its_training_recordings(bands):
    classifier = tl.load(bands).classifier
    found = classifier.statistics["haptic"]
    assert found.counts.tolist() == [8, 8, 8]  # without a test and a validation fold
    for kind in range(len(CLASSES)):
        means = [
            classifier.embedding("haptic", each).mean(1) for each in traces(kind, range(2, 10))
        ]
        torch.testing.assert_close(found.means[kind], torch.stack(means).mean(0))


def test_recordings_left_out_are_as_novel_as_new_ones():
    torch.manual_seed(0)
    centres = 4 * torch.randn(3, 40)
    labels = torch.arange(60) % 3
    rows, new = (centres[labels] + torch.randn(60, 40) for _ in range(2))
    groups = [str(number) for number in range(60)]
    found = leave_out_each(rows, labels, 3, groups)
    statistics = FeatureStatistics.of(rows, labels, 3)
    measures = (statistics.novelty, lambda x: statistics.nearest(x)[0])
    for column, measure in enumerate(measures):
        mean = found[:, column].mean()
        assert mean == pytest.approx(measure(new).mean().item(), rel=0.1)
        assert measure(rows).mean() < mean
    missed = statistics.nearest(new)[1] != labels
    assert found[:, 2].sum() == pytest.approx(missed.sum(), abs=3)
    some = leave_out_each(rows[:4], labels[:4], 3, groups[:4])[:, 0]
    assert some.isnan().tolist() == [False, True, True, False]  # of two there is but one
    assert leave_out_each(rows[:3], labels[:3], 3, groups[:3]).isnan().all()
    alone = leave_out_each(rows, labels, 3, [str(label) for label in labels.tolist()])
    torch.testing.assert_close(alone, found)  # recordings are left out


def test_as_many_known_recordings_are_rejected_as_asked_where_four_are_tiles_of_a_photo():
    """Tiles of a photo are alike: a threshold from tiles left out one by one rejected most."""
    torch.manual_seed(0)
    photos, tiles, classes, rate = 40, 4, 4, 0.05
    centres = 3 * torch.randn(classes, 120)
    labels = torch.arange(classes).repeat_interleave(photos * tiles)

    def draw() -> torch.Tensor:
        of_photos = torch.randn(classes * photos, 120).repeat_interleave(tiles, dim=0)
        return centres[labels] + of_photos + 0.1 * torch.randn(len(labels), 120)

    rows, new = draw(), draw()
    statistics = FeatureStatistics.of(rows, labels, classes)
    rejected = {}
    for name, size in (("tile", 1), ("photo", tiles)):
        groups = [str(number // size) for number in range(len(labels))]
        known = leave_out_each(rows, labels, classes, groups)[:, 0].tolist()
        rejected[name] = int((statistics.novelty(new) > novelty_threshold(known, rate)).sum())
    assert rejected["tile"] / len(new) > 0.5
    # of 160 photos, which are what is independent
    interval = binomtest(rejected["photo"] // tiles, classes * photos).proportion_ci(0.95, "wilson")
    assert interval.low < rate < interval.high


def test_strong_noise_in_most_features_does_not_hide_what_is_unknown():
    """Bands that hardly tell the classes had most of the variance, and decided the angle."""
    torch.manual_seed(0)
    telling, noisy, known, strange = 40, 400, 8, 4
    centres = 3 * torch.randn(known + strange, telling)

    def draw(labels: torch.Tensor) -> torch.Tensor:
        noise = 20 * torch.randn(len(labels), noisy)
        return torch.cat((centres[labels] + torch.randn(len(labels), telling), noise), dim=1)

    labels = torch.arange(known).repeat(30)
    rows, groups = draw(labels), [str(number) for number in range(len(labels))]
    novelties = leave_out_each(rows, labels, known, groups)[:, 0].tolist()
    threshold = novelty_threshold(novelties, 0.05)
    statistics = FeatureStatistics.of(rows, labels, known)
    rejected = statistics.novelty(draw(torch.arange(known).repeat(50))) > threshold
    accepted = statistics.novelty(draw(known + torch.arange(strange).repeat(50))) <= threshold
    assert 0.02 < rejected.double().mean() < 0.08
    assert accepted.double().mean() < 0.02


def with_embeddings(counts: list[int], spread: float) -> tuple[SurfaceClassifier, torch.Tensor]:
    """An untrained HapticNet with so many recordings of each class, and their mean features."""
    torch.manual_seed(0)
    classifier = SurfaceClassifier(make_card("haptic", width=0.1))
    labels = np.repeat(CLASSES, counts)
    rows = [Recording(label, "haptic", Path(f"{n}.wav"), n) for n, label in enumerate(labels)]
    size = classifier.network.score_layer.in_channels
    centres = torch.randn(len(CLASSES), size)[
        torch.arange(len(CLASSES)).repeat_interleave(torch.tensor(counts))
    ]
    features = spread * (5 + centres + torch.randn(len(labels), size) * torch.rand(size))
    classifier.trained_embeddings["haptic"] = rows, features
    return classifier, features


def centred_scores(classifier: SurfaceClassifier, features: torch.Tensor) -> np.ndarray:
    layer = classifier.network.score_layer
    scores = (features @ layer.weight.flatten(1).T + layer.bias).detach().numpy()
    return scores - scores.mean(axis=1, keepdims=True)


@pytest.mark.parametrize(("shrinkage", "share"), [(3.0, 0.75), (0.25, 0.2)])
def test_refitted_scores_are_scikit_learns_discriminants_and_as_confident_as_before(
    shrinkage, share
):
    classifier, features = with_embeddings([9, 9, 9], spread=1)
    before = centred_scores(classifier, features)
    assert refit_scores(classifier, shrinkage)
    after = centred_scores(classifier, features)
    labels = [row.label for row in classifier.trained_embeddings["haptic"][0]]
    # scikit-learn's share of the mean variance is of a sum of both, which changes the size alone
    theirs = LinearDiscriminantAnalysis("lsqr", shrinkage=share).fit(features.numpy(), labels)
    expected = theirs.decision_function(features.numpy())
    expected -= expected.mean(axis=1, keepdims=True)
    order = [list(theirs.classes_).index(name) for name in CLASSES]
    slope = np.vdot(after, expected[:, order]) / np.vdot(expected, expected)
    np.testing.assert_allclose(after, slope * expected[:, order], atol=1e-4 * after.std())
    assert after.std() == pytest.approx(before.std())


def test_scores_are_refitted_where_one_class_has_a_single_recording():
    counts = [1, 6, 9]
    classifier, features = with_embeddings(counts, spread=1)
    refit_scores(classifier, 3.0)
    found = centred_scores(classifier, features).argmax(axis=1)
    assert found.tolist() == np.repeat(range(len(CLASSES)), counts).tolist()


@pytest.mark.parametrize(
    ("counts", "spread"), [([5, 5, 4], 1), ([5, 5, 5], 0)], ids=["few", "all alike"]
)
def test_scores_stay_as_trained_where_nothing_tells_how_recordings_differ(counts, spread):
    classifier, features = with_embeddings(counts, spread)
    before = centred_scores(classifier, features)
    assert not refit_scores(classifier, 3.0)
    np.testing.assert_array_equal(centred_scores(classifier, features), before)


def test_scores_whose_weights_are_computed_stay_as_trained():
    classifier, features = with_embeddings([5, 5, 5], spread=1)
    weight_norm(classifier.network.score_layer)
    before = centred_scores(classifier, features)
    assert not refit_scores(classifier, 3.0)
    np.testing.assert_array_equal(centred_scores(classifier, features), before)
