import pytest
import torch
from sklearn.covariance import oas

from tex_lightning.classifier.statistics import FeatureStatistics


def drawn(recordings=40, features=6, classes=4, seed=0):
    torch.manual_seed(seed)
    labels = torch.arange(recordings) % classes
    mixing = torch.randn(features, features)
    centres = 5 * torch.randn(classes, features)
    return centres[labels] + torch.randn(recordings, features) @ mixing, labels, classes


def covariance(statistics):
    """The full matrix that scales, directions and variances stand for."""
    directions, size = statistics.directions, statistics.means.shape[1]
    along = directions.T @ torch.diag(statistics.variances - statistics.rest) @ directions
    scale = statistics.scales
    return scale[:, None] * (along + statistics.rest * torch.eye(size)) * scale


@pytest.mark.parametrize(("recordings", "features"), [(40, 6), (12, 30)])
def test_the_covariance_is_shrunk_as_scikit_learn_does(recordings, features):
    rows, labels, classes = drawn(recordings, features)
    found = FeatureStatistics.of(rows, labels, classes)
    scaled = rows / found.scales
    centred = torch.cat(
        [scaled[labels == each] - scaled[labels == each].mean(0) for each in range(4)]
    )
    freedom = recordings - classes
    # scikit-learn divides by the rows it gets; an orthogonal basis of the centred ones is as many
    _, scales, directions = torch.linalg.svd(centred.double(), full_matrices=False)
    basis = (scales[:, None] * directions)[:freedom]
    expected, _ = oas(torch.nn.functional.pad(basis, (0, 0, 0, freedom - len(basis))).numpy(),
                      assume_centered=True)  # fmt: skip
    expected = torch.from_numpy(expected).float() * found.scales * found.scales[:, None]
    torch.testing.assert_close(covariance(found), expected)
    assert found.counts.tolist() == [recordings // classes] * classes
    torch.testing.assert_close(found.means[1], rows[labels == 1].mean(0))


def test_novelty_is_that_of_the_angle_in_whitened_space():
    rows, labels, classes = drawn(40, 6)
    found = FeatureStatistics.of(rows, labels, classes)
    inverse = torch.linalg.inv(covariance(found).double())
    point = torch.randn(6)
    x, means = ((each - found.means.mean(dim=0)).double() for each in (point, found.means))
    lengths = ((x @ inverse @ x) * (means @ inverse * means).sum(dim=1)).sqrt()
    expected = 1 - (means @ inverse @ x) / lengths
    assert found.novelty(point).item() == pytest.approx(expected.min().item(), rel=1e-4)
    several = torch.stack([point, rows[0]])
    torch.testing.assert_close(found.novelty(several)[0], found.novelty(point))


def test_one_recording_of_each_class_is_like_no_other():
    rows, labels, classes = drawn(4, 6)
    assert FeatureStatistics.of(rows, labels, classes).novelty(rows).max() < 1e-5


def test_units_of_features_make_no_difference():
    """Thousands of noisy features drowned the few that tell, and four of five unknown ones."""
    rows, labels, classes = drawn(40, 6)
    units = torch.tensor([1e-3, 1, 1, 30, 1e3, 1])
    plain, scaled = (FeatureStatistics.of(each, labels, classes) for each in (rows, rows * units))
    points = 5 * torch.randn(20, 6)
    torch.testing.assert_close(scaled.novelty(points * units), plain.novelty(points))
    weights = torch.randn(3, 6)
    torch.testing.assert_close(
        points @ plain.weights_before(weights).T, plain.whiten(points) @ weights.T
    )


def test_a_scale_is_the_deviation_within_classes_over_how_much_they_differ():
    rows, labels, classes = drawn(4000, 6)
    more = torch.stack((torch.ones(4000), torch.randn(4000)), dim=1)  # neither tells the class
    found = FeatureStatistics.of(torch.cat((rows, more), dim=1), labels, classes).scales
    classwise = [rows[labels == each] for each in range(classes)]
    within = torch.cat([each - each.mean(0) for each in classwise]).std(dim=0)
    between = torch.stack([each.mean(0) for each in classwise]).std(dim=0, correction=0)
    torch.testing.assert_close(found[:6], within**2 / between, rtol=0.05, atol=0)
    assert found[7] == pytest.approx(10, rel=0.05)  # at most ten times its deviation
    assert 0 < found[6] < 100


def test_statistics_of_earlier_checkpoints_are_read():
    rows, labels, classes = drawn(40, 6)
    state = FeatureStatistics.of(rows, labels, classes).state_dict()
    del state["scales"], state["reach"], state["error"]
    found = FeatureStatistics.from_state(state)
    assert found.scales.tolist() == [1] * 6
    assert found.reliability(1e6 * rows).tolist() == [1] * len(rows)


def test_what_is_beyond_reach_counts_by_the_square_of_its_distance():
    rows, labels, classes = drawn(40, 6)
    found = FeatureStatistics.of(rows, labels, classes)
    closest = torch.cdist(found.whiten(rows), found.whiten(found.means)).amin(dim=1)
    torch.testing.assert_close(found.nearest(rows)[0], closest, rtol=1e-4, atol=1e-4)
    found.reach.copy_(closest.median())
    expected = (found.reach / closest).square().clamp(max=1)
    torch.testing.assert_close(found.reliability(rows), expected, rtol=1e-3, atol=1e-4)
    assert 0.4 < (expected == 1).float().mean() < 0.6


def test_directions_of_many_recordings_are_those_of_some_of_them(monkeypatch):
    rows, labels, classes = drawn(4000, 6)
    monkeypatch.setattr("tex_lightning.classifier.statistics.MAX_ROWS", 4000)
    every = FeatureStatistics.of(rows, labels, classes)
    monkeypatch.setattr("tex_lightning.classifier.statistics.MAX_ROWS", 999)
    some = FeatureStatistics.of(rows, labels, classes)
    torch.testing.assert_close(some.means, every.means)
    torch.testing.assert_close(some.scales, every.scales)
    assert not torch.equal(covariance(some), covariance(every))
    torch.testing.assert_close(covariance(some), covariance(every), rtol=0.2, atol=1)
