"""Classes that a network gets after its training."""

import pytest
import torch
from conftest import make_card

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.config.instantiation import trust
from tex_lightning.errors import UserError
from tex_lightning.learning.enrolment import add_classes, fit_new_class_weights

NEW = ["delta", "epsilon"]


def recordings(sense):
    generator = torch.Generator().manual_seed(0)
    if sense == "haptic":
        return [torch.randn(1, 24_000, generator=generator) for _ in range(3)]
    size = (240, 256, 3)
    return [torch.randint(256, size, dtype=torch.uint8, generator=generator) for _ in range(3)]


@torch.no_grad()
def described(classifier, senses):
    """By sense two recordings of one class and one of another."""
    found = {}
    for name in senses:
        one, other, third = (classifier.embedding(name, each) for each in recordings(name))
        found[name] = [[one, other], [third]]
    return found


def make_classifier(*senses, level="fc2", network=None):
    torch.manual_seed(0)
    card = make_card(*senses, level=level, width=0.1)
    if network is not None:
        card.senses["haptic"]["network"] = {"_target_": network}
    classifier = SurfaceClassifier(card).eval()
    features = described(classifier, senses)
    for name in senses:
        size = features[name][0][0].shape[0]
        rows = features[name][0][0].mean(dim=1) + torch.randn(9, size)
        labels = torch.arange(9) % 3
        classifier.statistics[name] = FeatureStatistics.of(rows, labels, 3)
    classifier.requires_grad_(False)
    return classifier, features


@pytest.mark.parametrize("network", [None, "own_networks.Residual"])  # a user's keeps its own
@torch.no_grad()
def test_scores_of_the_old_classes_stay(network):
    trust("own_networks")
    senses = ["haptic", "visual"]
    classifier, features = make_classifier(*senses, network=network)
    with torch.enable_grad():
        found = add_classes(classifier, NEW, features)
    assert found.card.classes == [*classifier.card.classes, *NEW]
    sample = {classifier.senses[name].modality: recordings(name)[0] for name in senses}
    before, after = classifier.logits(**sample), found.logits(**sample)
    assert after.shape == (5, before.shape[1])
    torch.testing.assert_close(after[:3], before)
    for name in senses:
        assert found.statistics[name].counts.tolist() == [3, 3, 3, 2, 1]
        expected = torch.stack([each.mean(1) for each in features[name][0]]).mean(0)
        torch.testing.assert_close(found.statistics[name].means[3], expected)


def gaussians(classes, seed=0):
    """Centres (classes, 8), and 400 features (8, 400) of each with a shared covariance."""
    generator = torch.Generator().manual_seed(seed)
    centres = 4 * torch.randn(classes, 8, generator=generator)
    mixing = torch.randn(8, 8, generator=generator) / 3
    noise = torch.randn(classes, 400, 8, generator=generator) @ mixing
    return centres, (centres[:, None] + noise).transpose(1, 2)


@pytest.mark.parametrize("new_bias", [None, 0.0])
def test_new_rows_beside_the_best_old_ones_are_nearly_the_best(new_bias):
    centres, features = gaussians(6)
    rows = features[:4].transpose(1, 2).flatten(0, 1)
    labels = torch.arange(4).repeat_interleave(400)
    statistics = FeatureStatistics.of(rows, labels, 4)
    inverse = torch.linalg.inv(torch.cov(features[0] - features[0].mean(1, keepdim=True)))
    weight = centres[:4] @ inverse  # linear discriminants, the best of Gaussians
    bias = -0.5 * (weight * centres[:4]).sum(dim=1)
    few = [[each[:, :5], each[:, 5:10]] for each in features[4:]]
    means = torch.stack([each[:, :10].mean(1) for each in features[4:]])
    whole = statistics.with_classes(means, torch.tensor([2, 2]))
    new, biases = fit_new_class_weights(
        whole, weight, bias, few, temperature=1.0, new_bias=new_bias
    )
    scores = torch.cat([weight, new]) @ features + torch.cat([bias, biases])[:, None]
    right = scores.argmax(dim=1) == torch.arange(6)[:, None]
    assert right.float().mean(dim=1).min() > 0.97
    if new_bias is not None:
        assert biases.tolist() == [new_bias, new_bias]


def test_a_fusion_of_scores_gets_no_classes():
    classifier, features = make_classifier("haptic", "visual", level="fc3")
    with pytest.raises(UserError, match=r"train it anew .* with model\.fusion\.level=fc2"):
        add_classes(classifier, NEW, features)


def test_a_network_without_a_score_layer_says_so():
    classifier, features = make_classifier("haptic")

    class Bare(torch.nn.Module):
        def __init__(self, network):
            super().__init__()
            self.inner = network
            self.features = network.features

    sense = classifier.senses["haptic"]
    sense.network = Bare(sense.network)
    with pytest.raises(UserError, match="Bare of haptic has no score_layer"):
        add_classes(classifier, NEW, features)
    for layer in (torch.nn.Conv1d(4, 3, 3), torch.nn.Conv1d(4, 3, 1, bias=False)):
        sense.network.score_layer = layer
        with pytest.raises(UserError, match="a convolution of kernel 1 with a bias"):
            add_classes(classifier, NEW, features)
