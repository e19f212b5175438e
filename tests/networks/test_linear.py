"""LinearNet against scikit-learn: the ridge, what is left out, the probabilities."""

import numpy as np
import pytest
import torch
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.linear_model import Ridge
from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

from tex_lightning.networks.linear import (
    LinearNet,
    _Ridge,
    discriminants,
    equal_scatter,
    scatter,
)

CLASSES, BANDS = 3, 12
SHRINKAGE = 3.0


def recordings(each: int, seed: int = 0) -> tuple[list[torch.Tensor], torch.Tensor]:
    """Features (1, D, L) of recordings of unequal length, and their labels."""
    rng = np.random.default_rng(seed)
    centres = 3 * rng.standard_normal((CLASSES, BANDS))
    labels = torch.arange(CLASSES).repeat(each)
    inputs = []
    for number, label in enumerate(labels.tolist()):
        noise = rng.standard_normal((BANDS, 3 + number % 4))
        inputs.append(torch.from_numpy(centres[label][:, None] + noise).float()[None])
    return inputs, labels


@pytest.mark.parametrize("bands", [BANDS, 60])  # fewer and more features than rows
def test_the_ridge_and_what_it_says_of_rows_that_it_has_not_seen_are_scikit_learns(bands):
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(CLASSES), [8, 12, 20])  # each class weighs the same
    rows, strength = rng.standard_normal((40, bands)) + labels[:, None] / 3, 0.05
    weight = 1 / (CLASSES * np.bincount(labels)[labels])
    kept = np.ones(bands)
    kept[3:5] = 0
    problem = _Ridge(torch.from_numpy(rows), torch.from_numpy(labels), CLASSES)
    centred = (rows - weight @ rows) * kept
    targets = np.eye(CLASSES)[labels] - 1 / CLASSES
    ridge = strength * (weight @ (centred**2).sum(axis=1)) / len(rows)
    theirs = Ridge(alpha=ridge, fit_intercept=False)
    groups = np.arange(40) % 5
    left_out = cross_val_predict(
        theirs, centred, targets, groups=groups, cv=LeaveOneGroupOut(),
        params={"sample_weight": weight},
    )  # fmt: skip
    gram = problem.gram(torch.from_numpy(kept))
    ours = problem.held_out(gram, strength, torch.from_numpy(groups))
    np.testing.assert_allclose(ours, left_out + 1 / CLASSES, atol=1e-8)
    weights = problem.solve(torch.from_numpy(kept), strength)
    np.testing.assert_allclose(weights.T, theirs.fit(centred, targets, weight).coef_, atol=1e-8)


class Shrunk:
    """A covariance estimator as scikit-learn takes it."""

    def fit(self, rows: np.ndarray) -> None:
        covariance = np.cov(rows.T, bias=True)
        self.covariance_ = covariance + SHRINKAGE * covariance.diagonal().mean() * np.eye(CLASSES)


def test_discriminants_of_the_scores_are_scikit_learns_with_equal_priors():
    rng = np.random.default_rng(0)
    labels = np.repeat(np.arange(CLASSES), [8, 12, 20])
    scores = np.eye(CLASSES)[labels] + rng.standard_normal((40, CLASSES)) @ np.diag([1, 0.5, 0.1])
    coefficients, intercept = discriminants(
        torch.from_numpy(scores), torch.from_numpy(labels), SHRINKAGE
    )
    theirs = LinearDiscriminantAnalysis(
        "lsqr", priors=np.full(CLASSES, 1 / CLASSES), covariance_estimator=Shrunk()
    ).fit(scores, labels)
    size = np.linalg.norm(theirs.coef_) / np.linalg.norm(coefficients)
    np.testing.assert_allclose(size * coefficients.T, theirs.coef_, atol=1e-10)
    np.testing.assert_allclose(size * intercept, theirs.intercept_ + np.log(CLASSES), atol=1e-10)


def test_levels_are_brought_to_equal_scatter_within_classes():
    rng = np.random.default_rng(0)
    labels = torch.arange(2).repeat(500)
    together = torch.from_numpy(rng.standard_normal((1000, 1)) @ np.ones((1, 3)))
    rows = 5 * together + torch.from_numpy(rng.standard_normal((1000, 3))) + labels[:, None]
    even = rows @ equal_scatter(rows, labels)
    _, within = scatter(even, labels, 0.0)
    variances = torch.linalg.eigvalsh(within)
    assert variances.max() < 1.1 * variances.min()
    torch.testing.assert_close(even.norm(), rows.norm())


@pytest.mark.parametrize("tells", [True, False])
def test_optional_features_are_used_where_they_help(tells):
    """Classes differ in the optional block, or it holds what differs between groups."""
    rng, size = np.random.default_rng(3), 6
    labels = torch.arange(2).repeat(30)
    shape = np.eye(size)[labels] + rng.standard_normal((60, size))
    power = 20 * rng.standard_normal((60, size)) * (not tells) + 5 * np.eye(size)[labels] * tells
    rows = torch.from_numpy(np.concatenate([shape, power], axis=1)).float()
    blocks = [("shape", size), ("power", size)]
    network = LinearNet(2, bands=2 * size, blocks=blocks, strength=0.01)
    network.fit(list(rows[:, None, :, None]), labels)
    assert bool(network.score_layer.weight[:, size:].any()) == tells


@pytest.mark.parametrize("each", [1, 5])
def test_unseen_recordings_are_told_apart_and_the_order_of_fragments_is_kept(each):
    network = LinearNet(CLASSES, bands=BANDS, strength=0.03)
    network.fit(*recordings(each))
    unseen, labels = recordings(20)  # the same centres, and the first of them the same noise
    for one, label in zip(unseen[3 * each :], labels[3 * each :].tolist(), strict=True):
        scores = network(one[None])
        assert scores.shape == (1, CLASSES, one.shape[-1])
        assert int(scores.mean(dim=2).argmax()) == label
        torch.testing.assert_close(scores[..., :1], network(one[None, ..., :1]))


def test_a_constant_that_is_added_to_every_feature_changes_no_score():
    inputs, labels = recordings(3)
    shifted = [one + 10 for one in inputs]
    network, other = (LinearNet(CLASSES, bands=BANDS, strength=0.03) for _ in range(2))
    network.fit(inputs, labels)
    other.fit(shifted, labels)
    expected, scores = network(inputs[0][None]), other(shifted[0][None])
    torch.testing.assert_close(scores, expected, rtol=0, atol=1e-3)


def test_a_feature_that_never_varies_says_nothing():
    inputs, labels = recordings(3)
    for one in inputs:
        one[:, 0] = 7.0
    network = LinearNet(CLASSES, bands=BANDS, strength=0.03)
    network.fit(inputs, labels)
    changed = inputs[0].clone()
    changed[:, 0] = -100
    torch.testing.assert_close(network(changed[None]), network(inputs[0][None]))


def test_probabilities_are_as_sure_as_they_are_right():
    rng = np.random.default_rng(1)
    labels = torch.arange(CLASSES).repeat(100)
    inputs = [
        torch.from_numpy(np.eye(BANDS)[label][:, None] + rng.standard_normal((BANDS, 1))).float()[
            None
        ]
        for label in labels.tolist()
    ]
    network = LinearNet(CLASSES, bands=BANDS, strength=0.03)
    network.fit(inputs[:150], labels[:150])
    probabilities = torch.stack(
        [network(one[None])[0, :, 0].softmax(dim=0) for one in inputs[150:]]
    )
    sure, found = probabilities.max(dim=1)
    accuracy = (found == labels[150:]).double().mean()
    assert 0.4 < accuracy < 0.95  # hard enough to be wrong at times
    assert abs(sure.double().mean() - accuracy) < 0.08


def test_pieces_of_a_group_do_not_answer_for_each_other():
    """Four pieces of a stroke are alike: left out one by one they make any score look right."""
    pieces, strokes, bands = 4, 30 * CLASSES, 40
    rng = np.random.default_rng(1)
    labels = torch.arange(CLASSES).repeat_interleave(strokes // CLASSES * pieces)

    def draw() -> list[torch.Tensor]:
        of_strokes = np.repeat(0.8 * rng.standard_normal((strokes, bands)), pieces, axis=0)
        rows = np.eye(bands)[labels] + of_strokes + 0.1 * rng.standard_normal(of_strokes.shape)
        return [torch.from_numpy(row).float()[None, :, None] for row in rows]

    inputs, unseen, sure = draw(), draw(), []
    for size in (1, pieces):
        network = LinearNet(CLASSES, bands=bands, strength=0.03)
        network.fit(inputs, labels, [str(number // size) for number in range(len(labels))])
        logits = torch.stack([network(one[None])[0, :, 0].detach() for one in unseen])
        sure.append(float(logits.softmax(dim=1).amax(dim=1).mean()))
    accuracy = float((logits.argmax(dim=1) == labels).double().mean())
    assert 0.4 < accuracy < 0.7
    assert sure[0] - accuracy > 0.2  # what pieces say
    assert abs(sure[1] - accuracy) < 0.1  # what strokes say


def test_features_of_fusion_are_standardised_or_the_scores():
    inputs, labels = recordings(4)
    network = LinearNet(CLASSES, bands=BANDS, strength=0.03)
    network.fit(inputs, labels)
    whole = torch.cat(inputs, dim=2)[None]
    means = torch.stack([one[0].mean(dim=1) for one in inputs])  # a row a recording
    expected = (whole[0, 0] - means.mean(dim=0)[:, None]) / means.std(dim=0, correction=0)[:, None]
    torch.testing.assert_close(network.features(whole, "fc2")[0], expected, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(network.features(whole, "fc3"), network(whole))
