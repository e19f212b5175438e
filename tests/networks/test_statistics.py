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
    """The full matrix that directions and variances stand for."""
    directions, size = statistics.directions, statistics.means.shape[1]
    along = directions.T @ torch.diag(statistics.variances - statistics.rest) @ directions
    return along + statistics.rest * torch.eye(size)


@pytest.mark.parametrize(("recordings", "features"), [(40, 6), (12, 30)])
def test_the_covariance_is_shrunk_as_scikit_learn_does(recordings, features):
    rows, labels, classes = drawn(recordings, features)
    found = FeatureStatistics.of(rows, labels, classes)
    centred = torch.cat([rows[labels == each] - rows[labels == each].mean(0) for each in range(4)])
    freedom = recordings - classes
    # scikit-learn divides by the rows it gets; an orthogonal basis of the centred ones is as many
    _, scales, directions = torch.linalg.svd(centred.double(), full_matrices=False)
    basis = (scales[:, None] * directions)[:freedom]
    expected, _ = oas(torch.nn.functional.pad(basis, (0, 0, 0, freedom - len(basis))).numpy(),
                      assume_centered=True)  # fmt: skip
    torch.testing.assert_close(covariance(found), torch.from_numpy(expected).float())
    assert found.counts.tolist() == [recordings // classes] * classes
    torch.testing.assert_close(found.means[1], rows[labels == 1].mean(0))


def test_novelty_is_that_of_the_angle_in_whitened_space():
    rows, labels, classes = drawn(40, 6)
    found = FeatureStatistics.of(rows, labels, classes)
    values, vectors = torch.linalg.eigh(covariance(found).double())
    root = vectors @ torch.diag(values.rsqrt()) @ vectors.T
    centre = found.means.mean(dim=0)
    point = torch.randn(6)
    x, means = root @ (point - centre).double(), (found.means - centre).double() @ root
    expected = 1 - (means @ x) / (x.norm() * means.norm(dim=1))
    assert found.novelty(point).item() == pytest.approx(expected.min().item(), rel=1e-4)
    several = torch.stack([point, rows[0]])
    torch.testing.assert_close(found.novelty(several)[0], found.novelty(point))


def test_one_recording_of_each_class_is_like_no_other():
    rows, labels, classes = drawn(4, 6)
    assert FeatureStatistics.of(rows, labels, classes).novelty(rows).max() < 1e-5
