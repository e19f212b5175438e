"""Networks that are fitted again with unlabelled recordings, and when they are left alone."""

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import make_card
from torch import nn

from tex_lightning.classifier.card import NOVELTIES
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics, TrainingRows
from tex_lightning.errors import UserError
from tex_lightning.learning.adaptation import Unsafe, adapt, check_told_apart
from tex_lightning.networks.linear import LinearNet
from tex_lightning.networks.planes import fit_planes

CLASSES, BANDS, LEVELS = 8, 40, 4
EVERY = range(CLASSES)


def recordings(counts: dict[int, int], seed: int = 0) -> tuple[list[torch.Tensor], np.ndarray]:
    """Features (D, 3) of recordings of classes, and their labels; class 8 is unknown.

    They scatter along more directions than a recording or two of each class tell.
    """
    rng = np.random.default_rng(5)
    centres = rng.standard_normal((CLASSES + 1, BANDS))
    scatter = 0.25 * rng.standard_normal((16, BANDS))
    rng = np.random.default_rng([seed, 1])
    labels = np.repeat(np.array([*counts], int), [*counts.values()])
    rows = centres[labels] + rng.standard_normal((len(labels), 16)) @ scatter
    rows = rows[:, :, None] + 0.3 * rng.standard_normal((len(labels), BANDS, 3))
    return [*torch.from_numpy(rows).float()], labels


def make_classifier(each: int, levels: int = LEVELS) -> SurfaceClassifier:
    """Of a network that was fitted to so many recordings of each class."""
    inputs, numbers = recordings(dict.fromkeys(EVERY, each), seed=9)
    blocks = [("shape", BANDS - levels), ("level", levels)] if levels else None
    network = LinearNet(CLASSES, bands=BANDS, blocks=blocks)
    labels = torch.from_numpy(numbers)
    network.fit([x[None] for x in inputs], labels)
    made = SurfaceClassifier(make_card("haptic", classes=[*"abcdefgh"]))
    made.senses["haptic"].network = network
    means = torch.stack([x.mean(dim=1) for x in embeddings(network, inputs)])
    made.statistics["haptic"] = FeatureStatistics.of(means, labels, CLASSES)
    made.rows["haptic"] = TrainingRows.of(means, labels, range(len(labels)))
    return made.eval()


@pytest.fixture(scope="module")
def classifier() -> SurfaceClassifier:
    return make_classifier(2)


@torch.no_grad()
def embeddings(network, inputs):
    return [network.features(x[None, None], "fc2")[0] for x in inputs]


@torch.no_grad()
def right(network, inputs, labels) -> int:
    found = [int(network(x[None, None])[0].mean(dim=1).argmax()) for x in inputs]
    return int((np.array(found) == labels).sum())


def adapted(classifier, counts):
    """What becomes of it, and how many recordings are right before and after."""
    inputs, labels = recordings(counts)
    found = adapt(classifier, embeddings(classifier.network, inputs))
    before, after = (right(x.network, inputs, labels) for x in (classifier, found.classifier))
    return found, before, after


@pytest.mark.parametrize(
    ("counts", "most"),
    [
        (dict.fromkeys(EVERY, 30), 240),
        (dict.fromkeys(range(4), 30), 120),
        (dict.fromkeys(range(CLASSES + 1), 30), 240),
    ],
    ids=["all", "half", "one unknown"],
)
def test_unlabelled_recordings_help(classifier, counts, most):
    found, before, after = adapted(classifier, counts)
    assert before < 0.96 * most
    assert after == most
    assert not found.reason
    assert found.recordings == sum(counts.values())
    assert sum(found.taught.values()) < found.recordings
    assert found.changed >= after - before
    assert str(found).startswith(f"Adapted to {found.recordings} recordings, of which")


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        (dict.fromkeys(range(5), 2), "of 10 recordings only .* clearly among them"),
        ({0: 30, 5: 30}, "would not be told apart more clearly"),
        ({0: 100} | dict.fromkeys(range(1, CLASSES), 10), "of 170 recordings only"),
        ({}, "there are no recordings"),
    ],
)
def test_what_tells_too_little_changes_nothing(classifier, counts, said):
    found = adapt(classifier, embeddings(classifier.network, recordings(counts)[0]))
    assert found.classifier is classifier
    assert not found.taught
    with pytest.raises(AssertionError, match=said):
        raise AssertionError(str(found))


def test_what_is_called_unknown_teaches_nothing(classifier):
    inputs, labels = recordings(dict.fromkeys(range(CLASSES + 1), 30))
    features = embeddings(classifier.network, inputs)
    statistics = classifier.statistics["haptic"]
    novelties = [float(statistics.novelty(x.mean(dim=1))) for x in features]
    known = [x for x, label in zip(novelties, labels, strict=True) if label < CLASSES]
    strict = deepcopy(classifier)
    strict.card = replace(
        strict.card,
        decision={**strict.card.decision, "unknown": 0.05},
        calibration={NOVELTIES: {"haptic": known}},
    )
    near = [x <= strict.card.unknown_above for x in novelties]
    assert sum(near) < 0.98 * len(near)
    found = adapt(strict, features, strict.card.unknown_above)
    without = adapt(classifier, [x for x, is_near in zip(features, near, strict=True) if is_near])
    assert not found.reason
    assert (found.recordings, found.taught) == (sum(near), without.taught)
    strict.card = replace(strict.card, calibration={NOVELTIES: {"haptic": [-1.0]}})
    nothing = adapt(strict, features, strict.card.unknown_above)
    assert nothing.reason == "there are no recordings of known classes"


def test_one_training_recording_of_a_class_does_not_tell_which_are_absent():
    alone = make_classifier(1)
    found, *_ = adapted(alone, dict.fromkeys(range(4), 30))
    assert "of 8 classes are clearly among the recordings" in found.reason
    assert "does not tell which are absent" in found.reason


def test_what_is_doubted():
    """Two classes, the scores of which are a line: with a gap, cut in two, or dense in between."""
    line = torch.linspace(-1, 1, 100)
    apart, cut, between = (
        torch.stack([x, -x], dim=1) for x in (line.sign() + line / 4, line, line.sign() * line**2)
    )
    check_told_apart(between, apart, apart)
    for scores, message in (
        ((apart, apart, apart), "would not be told apart more clearly"),
        ((between, cut, cut), "50 of 100 recordings are of classes without a gap"),
        ((between, apart.roll(50, 0), apart), "only 0 of 100 have the same label"),
    ):
        with pytest.raises(Unsafe, match=message):
            check_told_apart(*scores)


def test_neither_order_nor_the_given_classifier_changes_anything(classifier):
    inputs = embeddings(classifier.network, recordings(dict.fromkeys(EVERY, 10))[0])
    before = deepcopy(classifier.state_dict())
    one, other = (adapt(classifier, x) for x in (inputs, inputs[::-1]))
    assert one.taught == other.taught
    states = one.classifier.state_dict(), other.classifier.state_dict()
    torch.testing.assert_close(*states, rtol=0, atol=0)
    torch.testing.assert_close(classifier.state_dict(), before, rtol=0, atol=0)


def test_what_a_checkpoint_keeps_fits_the_new_network(classifier):
    found, _, after = adapted(classifier, dict.fromkeys(EVERY, 30))
    new = found.classifier
    rows, known = new.rows["haptic"], classifier.rows["haptic"]
    assert rows.labels.tolist() == known.labels.tolist()
    assert rows.groups.tolist() == known.groups.tolist()
    training, _ = recordings(dict.fromkeys(EVERY, 2), seed=9)
    means = torch.stack([x.mean(dim=1) for x in embeddings(new.network, training)])
    torch.testing.assert_close(rows.features.float(), means, rtol=0, atol=0.02)
    statistics = new.statistics["haptic"]
    assert statistics.counts.tolist() == [2 + found.taught[name] for name in "abcdefgh"]
    assert statistics.has_reach
    assert len(new.card.novelties["haptic"]) == len(known.labels) + sum(found.taught.values())
    inputs, labels = recordings(dict.fromkeys(EVERY, 30))
    again = adapt(new, embeddings(new.network, inputs))
    assert right(again.classifier.network, inputs, labels) == after


def test_what_scores_short_recordings_does_not_score_whole_ones(classifier):
    """The mean of a recording is one fragment, and would be taken for a short one."""
    other = deepcopy(classifier)
    line = {"weight": torch.zeros(CLASSES, BANDS, 1, 1), "bias": torch.eye(CLASSES)[0]}
    other.network.head.scores.short.take({**line, "most": torch.tensor(2.0)})
    inputs, labels = recordings(dict.fromkeys(EVERY, 30))
    for one in (classifier, other):
        found = adapt(one, embeddings(one.network, inputs))
        assert right(found.classifier.network, inputs, labels) == len(labels)
    assert other.network.head.scores.short.in_use


def test_the_range_of_a_network_is_told_again_and_short_recordings_are_as_before():
    inputs, labels = recordings(dict.fromkeys(EVERY, 30))
    inputs = [x.repeat(1, 4) for x in inputs]  # 12 fragments
    fresh = make_classifier(2, levels=0)
    for former in (False, True):
        if former:  # a checkpoint without a range
            fresh.network.head.scores.range.take(None)
        found = adapt(fresh, embeddings(fresh.network, inputs))
        assert right(found.classifier.network, inputs, labels) == len(labels)
        assert found.classifier.network.head.scores.range.most == 3


def test_what_cannot_be_fitted_again_is_said(classifier):
    def refused(other, said):
        with pytest.raises(UserError, match=said):
            adapt(other, [])

    refused(SurfaceClassifier(make_card("haptic", "visual")), "fusion network, and task=adapt fits")
    refused(SurfaceClassifier(make_card("haptic")), "not fitted in closed form")
    without = deepcopy(classifier)
    without.rows = nn.ModuleDict()
    refused(without, "keeps no features of its training recordings")
    bent = deepcopy(classifier)
    inputs, labels = recordings(dict.fromkeys(EVERY, 3))
    planes = bent.network.head.scores.planes
    planes.fit(fit_planes([x.T.double() for x in inputs], torch.from_numpy(labels), CLASSES), 1.0)
    refused(bent, "are planes")
