"""Planes of classes: where they take the line's place, their scores, and what is stored."""

import copy

import pytest
import torch

from tex_lightning.networks.linear import LinearNet
from tex_lightning.networks.planes import fit_planes

SIZE = 6


def strokes(classes: int, each: int, seed: int, *, curved: bool) -> tuple[list, torch.Tensor]:
    """Features (1, D, L) of strokes along one direction of each class, or about a mean of each."""
    shape, drawn = torch.Generator().manual_seed(7), torch.Generator().manual_seed(seed)
    means = torch.randn(classes, SIZE, generator=shape) * (1 if curved else 4)
    ways = torch.randn(classes, SIZE, generator=shape) * (10 if curved else 0)
    labels = torch.arange(classes).repeat(each)
    inputs = []
    for label in labels.tolist():
        place = torch.randn(1, generator=drawn) + 0.1 * torch.randn(8, generator=drawn).cumsum(0)
        noise = 0.5 * torch.randn(SIZE, 8, generator=drawn)
        inputs.append((means[label][:, None] + ways[label][:, None] * place + noise)[None])
    return inputs, labels


def fitted(*, curved: bool, each: int = 8) -> LinearNet:
    network = LinearNet(6, bands=SIZE, blocks=[("mean", SIZE)])
    network.fit(*strokes(6, each, 0, curved=curved))
    return network


def right(network: LinearNet, *, curved: bool) -> float:
    inputs, labels = strokes(6, 20, 1, curved=curved)
    scores = torch.stack([network(x[None])[0].mean(dim=1) for x in inputs])
    return float((scores.argmax(dim=1) == labels).double().mean())


@pytest.fixture(scope="module")
def curved() -> LinearNet:
    return fitted(curved=True)


def by_line(network: LinearNet) -> LinearNet:
    """Return a copy that has lost its planes."""
    line = copy.deepcopy(network)
    line.head.scores.planes.take(None)
    return line


def test_classes_that_differ_in_how_they_vary_are_told_apart(curved):
    assert right(curved, curved=True) > 0.9
    assert right(by_line(curved), curved=True) < 0.75


def test_probabilities_of_planes_are_no_surer_than_they_are_right(curved):
    inputs, labels = strokes(6, 50, 2, curved=True)
    shares = torch.stack([curved(x[None])[0].mean(dim=1) for x in inputs]).softmax(dim=1)
    correct = (shares.argmax(dim=1) == labels).double().mean()
    assert 0.6 < shares.max(dim=1).values.mean() < correct + 0.05


@pytest.mark.parametrize(("is_curved", "each"), [(False, 8), (True, 3)])
def test_the_line_stays_where_it_is_as_good_or_classes_have_few_strokes(is_curved, each):
    network = fitted(curved=is_curved, each=each)
    assert not network.head.scores.planes.in_use
    assert all(x.numel() == 0 for x in network.head.scores.planes.buffers())


def test_recordings_of_one_fragment_have_no_planes():
    network = LinearNet(6, bands=SIZE, blocks=[("mean", SIZE)])
    inputs, labels = strokes(6, 8, 0, curved=True)
    network.fit([x[..., :1] for x in inputs], labels)
    assert not network.head.scores.planes.in_use


def test_scores_are_logarithms_of_normal_densities():
    inputs, labels = strokes(3, 8, 0, curved=True)
    planes = fit_planes([x[0].T.double() for x in inputs], labels, 3)
    x = inputs[0][0].double()
    z = (planes.projection @ x - planes.centre).T
    for number, score in enumerate(planes.scores(x)):
        precision = torch.eye(z.shape[1]).double() * planes.precision[number]
        ways = planes.directions[number]
        precision += ways.T @ torch.diag(planes.narrow[number]) @ ways
        apart = z - planes.means[number]
        expected = (precision.logdet() - (apart @ precision * apart).sum(dim=1)) / 2
        torch.testing.assert_close(score, expected)


def test_a_state_is_loaded_with_planes_and_without_and_refused_for_other_classes(curved):
    x, other = strokes(6, 1, 3, curved=True)[0][0][None], fitted(curved=False)
    state = curved.state_dict()
    older = {name: value for name, value in state.items() if "planes" not in name}
    other.load_state_dict(state)
    torch.testing.assert_close(other(x), curved(x))
    other.load_state_dict(older)  # of before there were planes
    torch.testing.assert_close(other(x), by_line(curved)(x))
    more = state | {
        "head.scores.1.weight": torch.zeros(7, SIZE, 1, 1), "head.scores.1.bias": torch.zeros(7),
    }  # fmt: skip
    with pytest.raises(RuntimeError, match=r"planes.means has the shape \[6, \d+\]"):
        LinearNet(7, bands=SIZE, blocks=[("mean", SIZE)]).load_state_dict(more)


def test_scores_keep_the_layout_of_positions(curved):
    x = strokes(6, 1, 3, curved=True)[0][0][None]
    columns = curved.head.scores(curved.features(x, "fc2")[:, :, :, None])
    torch.testing.assert_close(columns[..., 0], curved(x))
    torch.testing.assert_close(curved(x[..., :5]), curved(x)[..., :5])
