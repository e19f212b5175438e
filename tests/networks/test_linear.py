"""LinearNet: what is chosen, what is out of range, few recordings of a class, the probabilities."""

import copy
import pickle

import numpy as np
import pytest
import torch

from tex_lightning.networks.line import ScoreReach
from tex_lightning.networks.linear import LinearNet
from tex_lightning.networks.range import FeatureRange, RangeGate

CLASSES, BANDS = 3, 12


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


@pytest.mark.parametrize("first", [0, 1])
def test_optional_features_of_every_second_take_are_not_used(first):
    """As many rows as settings are not all chosen on; in the other takes the block is noise."""
    rng, size, count = np.random.default_rng(3), 2, 620
    labels, take = torch.arange(2).repeat_interleave(count // 2), np.arange(count)[:, None] % 2
    shape = np.eye(size)[labels] + rng.standard_normal((count, size))
    noise = 200 * rng.standard_normal((count, size))
    power = np.where(take == first, 5 * np.eye(size)[labels], noise)
    rows = torch.from_numpy(np.concatenate([shape, power], axis=1)).float()
    network = LinearNet(2, bands=2 * size, blocks=[("shape", size), ("power", size)], strength=0.01)
    network.fit(list(rows[:, None, :, None]), labels)
    assert not network.score_layer.weight[:, size:].any()


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


def rows(values: np.ndarray) -> list[torch.Tensor]:
    """Features (1, D, 1) of recordings, from (recordings, D)."""
    return list(torch.from_numpy(values).float()[:, None, :, None])


@pytest.mark.parametrize("seed", range(3))
def test_what_is_left_out_has_not_told_its_label(seed):
    """Of noise nothing can be known: scores of levels that were whitened by all labels claim it."""
    rng, levels = np.random.default_rng(seed), 16
    labels = torch.arange(4).repeat(10)
    network = LinearNet(4, bands=levels, blocks=[("level", levels)])
    network.fit(rows(rng.standard_normal((40, levels))), labels)
    unseen = torch.from_numpy(rng.standard_normal((400, levels))).float()[:, None, :, None]
    confidence = network(unseen)[:, :, 0].softmax(dim=1).amax(dim=1)
    assert confidence.mean() < 0.45  # right in a quarter


def test_a_strength_at_the_end_of_the_grid_is_gone_beyond():
    rng = np.random.default_rng(0)
    labels = torch.arange(2).repeat(20)
    network = LinearNet(2, bands=200)
    network.fit(rows(rng.standard_normal((40, 200))), labels)
    weak = LinearNet(2, bands=200, strength=1.0)
    weak.fit(rows(rng.standard_normal((40, 200))), labels)
    small, large = (x.score_layer.weight.norm() for x in (network, weak))
    assert small < 0.7 * large  # noise is worth no weight


def mixed(counts: list[int], seed: int) -> tuple[np.ndarray, torch.Tensor]:
    """Rows of classes with so many recordings, which vary more than the classes differ."""
    rng, centres = np.random.default_rng(seed), np.random.default_rng(9).standard_normal((8, 60))
    labels = torch.repeat_interleave(torch.arange(8), torch.tensor(counts))
    return centres[labels] + 1.5 * rng.standard_normal((len(labels), 60)), labels


def test_a_class_of_one_recording_is_found_beside_classes_of_many():
    values, labels = mixed([12, 1] * 4, seed=0)
    network = LinearNet(8, bands=60)
    network.fit(rows(values), labels)
    unseen, truth = mixed([50] * 8, seed=1)
    found = network(torch.stack(rows(unseen)))[:, :, 0].argmax(dim=1)
    recall = [float((found == label)[truth == label].double().mean()) for label in range(8)]
    assert np.mean(recall[1::2]) > 0.4  # 0.2 without regard to their number
    assert np.mean(recall[::2]) > 0.8


def test_one_class_of_one_recording_changes_nothing_for_the_others():
    """Fragments of one recording are alike, and rows of all classes if one class has but one."""
    rng, centres = np.random.default_rng(4), np.random.default_rng(9).standard_normal((8, 60))
    labels = torch.repeat_interleave(torch.arange(8), torch.tensor([6] * 7 + [1]))
    means = centres[labels] + rng.standard_normal((43, 60))
    inputs = [torch.from_numpy(m[:, None] + 0.01 * rng.standard_normal((60, 9))) for m in means]
    network = LinearNet(8, bands=60)
    network.fit([x.float()[None] for x in inputs], labels)
    unseen, truth = mixed([40] * 7 + [0], seed=1)
    scores = network(torch.stack(rows(unseen)))[:, :, 0].detach().softmax(dim=1)
    accuracy = float((scores.argmax(dim=1) == truth).double().mean())
    assert abs(float(scores.amax(dim=1).mean()) - accuracy) < 0.2  # 0.5 more where fragments told


@pytest.mark.parametrize("kind", ["band", "level"])
def test_what_lies_outside_of_everything_in_training_does_not_decide(kind):
    rng = np.random.default_rng(0)
    labels = torch.arange(2).repeat(30)
    values = np.eye(2)[labels].repeat(6, axis=1) + 0.3 * rng.standard_normal((60, 12))
    blocks = [("shape", 6), ("level" if kind == "level" else "shape", 6)]
    bins = None if kind == "level" else [-1] * 6 + [0, 0, 0, 1, 1, 1]
    network = LinearNet(2, bands=12, blocks=blocks, bins=bins, strength=0.01)
    network.fit(rows(values), labels)
    changed = values.copy()
    changed[:, 6:9] += 100 * (1 - 2 * labels[:, None].numpy())  # towards the other class
    scores = network(torch.stack(rows(changed)))[:, :, 0]
    assert (scores.argmax(dim=1) == labels).all()
    inside = network(torch.stack(rows(values)))[:, :, 0]
    assert not torch.equal(scores, inside)
    embedding = network.features(torch.stack(rows(changed)), "fc2")
    assert embedding[:, 6:9].abs().mean() > 10  # what is unknown still shows


def test_many_classes_are_told_apart_with_probabilities_that_are_as_sure_as_right():
    """Settings were chosen on so few rows of each class that none could be left out."""
    rng, classes = np.random.default_rng(0), 320
    labels = torch.arange(classes).repeat_interleave(6)
    new = torch.arange(6).repeat(classes) >= 4
    centres = rng.standard_normal((classes, 20))
    rows = centres[labels] + 0.4 * rng.standard_normal((len(labels), 20))
    inputs = torch.from_numpy(rows).float()[:, None, :, None]
    network = LinearNet(classes, bands=20)
    network.fit([*inputs[~new]], labels[~new])
    with torch.no_grad():
        sure, found = network(inputs[new])[..., 0].softmax(dim=1).max(dim=1)
    right = (found == labels[new]).float().mean()
    assert right > 0.95
    assert abs(sure.mean() - right) < 0.1


def test_short_recordings_are_scored_by_a_fit_to_pieces_too_and_long_ones_as_without():
    inputs, labels = recordings(4)
    inputs = [torch.cat([x] * 4, dim=2) for x in inputs]  # 12 to 24 fragments
    pieces = [(number, x[..., :1] + 0.5) for number, x in enumerate(inputs) if number != 3]
    cut, without, both = (LinearNet(CLASSES, bands=BANDS) for _ in range(3))
    cut.eval().fit(inputs, labels, pieces=pieces)
    without.fit(inputs, labels)
    numbers = [number for number, _ in pieces]
    rows = [inputs[number] for number in numbers] + [x for _, x in pieces]
    both.fit(rows, labels[numbers * 2], recordings=numbers * 2)
    unseen = recordings(8)[0][-1][None]
    for fragments, expected in ((1, both), (4, both), (5, without)):
        x = torch.cat([unseen] * 2, dim=3)[..., :fragments]
        torch.testing.assert_close(cut(x), expected(x), rtol=1e-3, atol=1e-3)
    torch.testing.assert_close(without(unseen[..., :1]), without(unseen)[..., :1])
    cut.train()  # of a fusion, on single fragments of whole recordings
    torch.testing.assert_close(cut(unseen[..., :1]), without(unseen[..., :1]))
    cut.fit(inputs, labels)  # anew, without pieces
    assert all(x.numel() == 0 for x in cut.head.scores.short.buffers())


@pytest.mark.parametrize(("levels", "cut"), [(0, 1), (4, CLASSES)])
def test_levels_or_a_class_without_pieces_leave_short_recordings_to_the_line_of_all(levels, cut):
    inputs, labels = recordings(4)
    inputs = [torch.cat([x] * 4, dim=2) for x in inputs]
    blocks = [("shape", BANDS - levels), ("level", levels)] if levels else None
    network = LinearNet(CLASSES, bands=BANDS, blocks=blocks)
    network.fit(inputs, labels, pieces=[(number, inputs[number][..., :1]) for number in range(cut)])
    assert not network.head.scores.short.in_use


def slow_recordings(spread: float, gain: float = 0.0, seed: int = 0):
    """Rows of four classes that differ in shape, and in level by so much; the last are loudness."""
    rng, labels = np.random.default_rng(seed), torch.arange(4).repeat(8)
    shape = spread * np.eye(4)[labels] @ np.random.default_rng(1).standard_normal((4, 6))
    level = np.tile(np.arange(4.0)[labels][:, None], 4)
    values = np.concatenate((shape, level), axis=1) + 0.2 * rng.standard_normal((32, 10))
    values[:, -2:] += gain
    return rows(values), labels


SLOW = [("shape", 6), ("level", 2), ("level", 2)]
SLOW12 = [("shape", 8), ("level", 2), ("level", 2)]


@pytest.mark.parametrize("gain", [-12.0, 12.0])
def test_a_strength_that_no_training_had_is_scored_by_shape_alone(gain):
    network, shapes = LinearNet(4, bands=10, blocks=SLOW), LinearNet(4, bands=6)
    inputs, labels = slow_recordings(1)
    network.fit(inputs, labels)
    shapes.fit([x[:, :6] for x in inputs], labels)
    shapes.head.scores.range.take(None)  # one of six features is soon out of range
    state = network.state_dict()
    loaded = LinearNet(4, bands=10, blocks=SLOW)
    loaded.load_state_dict(state)
    other = slow_recordings(1, gain, seed=3)[0]
    scores = torch.cat([loaded.eval()(x[None]) for x in other])
    expected = torch.cat([shapes.eval()(x[None, :, :6]) for x in other])
    torch.testing.assert_close(scores, expected, rtol=1e-3, atol=1e-3)
    assert (scores[..., 0].argmax(dim=1) == labels).float().mean() > 0.9
    usual = slow_recordings(1, seed=4)[0]
    before = [loaded(x[None]) for x in usual]
    loaded.head.scores.gainless.take(None)
    assert not torch.allclose(torch.cat([loaded(x[None]) for x in other]), scores, atol=0.1)
    for x, expected in zip(usual, before, strict=True):
        torch.testing.assert_close(loaded(x[None]), expected, rtol=0, atol=0)


def test_a_strength_of_another_class_than_the_shape_tells_is_doubted():
    network, shapes = LinearNet(4, bands=10, blocks=SLOW), LinearNet(4, bands=6)
    inputs, labels = slow_recordings(1)
    network.fit(inputs, labels)
    shapes.fit([x[:, :6] for x in inputs], labels)
    shapes.head.scores.range.take(None)  # one of six features is soon out of range
    network.head.scores.reach.take(None)
    shapes.head.scores.reach.take(None)
    other = slow_recordings(0.8, seed=3)[0]  # none lies farther out than all of the training
    doubted = [x.clone() for x in other]
    for x, label in zip(doubted, labels, strict=True):
        x[:, -2:] += 2.5 if label < 2 else -2.5  # as loud as another class
    scores = [network.eval()(x[None]) for x in (*other, *doubted)]
    network.head.scores.gainless.take(None)
    usual = [network(x[None]) for x in (*other, *doubted)]
    for before, after in zip(usual[:32], scores[:32], strict=True):
        torch.testing.assert_close(after, before, rtol=0, atol=0)
    both = [
        (before + shapes.eval()(x[None, :, :6])) / 2
        for x, before in zip(doubted, usual[32:], strict=True)
    ]
    are_doubted = [torch.allclose(*pair, atol=1e-3) for pair in zip(scores[32:], both, strict=True)]
    assert sum(are_doubted) >= 28


def test_a_shape_beyond_all_training_tells_no_strength():
    network = LinearNet(4, bands=10, blocks=SLOW)
    inputs, labels = slow_recordings(1)
    network.fit(inputs, labels)
    odd = inputs[0].clone()
    odd[:, -2:] += 2
    beyond = odd.clone()
    beyond[:, :6] *= 10
    assert network.head.scores.odd.in_use
    for x, doubted in ((odd, True), (beyond, False)):
        scores = network.eval()(x[None])
        changed = copy.deepcopy(network)
        changed.head.scores.odd.take(None)
        assert torch.allclose(scores, changed(x[None])) != doubted


def test_a_network_that_was_pickled_before_doubts_no_strength():
    network = LinearNet(4, bands=10, blocks=SLOW)
    inputs, labels = slow_recordings(1)
    network.fit(inputs, labels)
    del network.head.scores._modules["odd"]
    loaded = pickle.loads(pickle.dumps(network.eval()))
    assert not loaded.head.scores.odd.in_use
    found = [int(loaded(x[None]).argmax(dim=1)) for x in inputs]
    assert found == labels.tolist()


def test_fragments_of_single_recordings_tell_no_strength():
    inputs, labels = slow_recordings(1)
    network = LinearNet(4, bands=10, blocks=SLOW)
    network.fit([torch.cat(inputs[label::4], dim=2) for label in range(4)], labels[:4])
    assert network.head.scores.gainless.in_use
    assert not network.head.scores.odd.in_use


def test_what_levels_alone_tell_is_told_by_them_at_any_strength():
    inputs, labels = slow_recordings(0)
    for blocks in (SLOW, [("power", 6), *SLOW[1:]]):
        network = LinearNet(4, bands=10, blocks=blocks)
        network.fit(inputs, labels)
        assert not network.head.scores.gainless.in_use
    network = LinearNet(4, bands=10, blocks=[("power", 6), *SLOW[1:]])
    network.fit(*slow_recordings(1))  # power depends on the gain, whatever it tells
    assert not network.head.scores.gainless.in_use


def disturbed_along(direction: torch.Tensor, inputs: list[torch.Tensor]):
    """Pairs of inputs, and of the same moved to and fro."""
    ways = [(-1) ** number * direction[:, None] for number in range(len(inputs))]
    return [(x, x + way) for x, way in zip(inputs, ways, strict=True)]


def test_scores_hardly_follow_what_disturbs_and_classes_are_told_apart_as_well():
    inputs, labels = recordings(6)
    direction = torch.from_numpy(np.random.default_rng(8).standard_normal(BANDS)).float()
    plain, steady, weak = (LinearNet(CLASSES, bands=BANDS) for _ in range(3))
    plain.fit(inputs, labels)
    steady.fit(inputs, labels, disturbed=disturbed_along(direction, inputs))
    weak.fit(inputs, labels, disturbed=disturbed_along(direction / 100, inputs))
    along = [
        (net.score_layer.weight[:, :, 0, 0] * net.scale[:, 0, 0]) @ direction
        for net in (plain, steady, weak)
    ]
    assert along[1].norm() < along[0].norm() / 2
    torch.testing.assert_close(along[2], along[1], rtol=1e-2, atol=1e-3)  # however strong it is
    unseen, truth = recordings(30)
    for network in (plain, steady):
        found = [int(network(x[None]).mean(dim=2).argmax()) for x in unseen]
        assert np.mean(np.array(found) == truth.numpy()) > 0.95


def test_levels_may_follow_what_disturbs():
    """A level is brought to equal scatter by the training, and has no place among changes."""
    inputs, labels = recordings(5)
    blocks = [("shape", BANDS - 2), ("level", 2)]
    networks = [LinearNet(CLASSES, bands=BANDS, blocks=blocks) for _ in range(2)]
    level = torch.zeros(BANDS)
    level[-1] = 9
    networks[0].fit(inputs, labels)
    networks[1].fit(inputs, labels, disturbed=disturbed_along(level, inputs))
    weights = [network.score_layer.weight for network in networks]
    torch.testing.assert_close(*weights)


def test_a_recording_unlike_all_in_training_is_moved_to_the_edge_of_what_they_reach():
    rng, labels, size = np.random.default_rng(0), torch.arange(3).repeat(10), 40
    centres = 3 * rng.standard_normal((3, size))
    values = centres[labels] + rng.standard_normal((30, size))
    values = np.hstack((values, np.full((30, 100), 2.0)))  # what never varies does not count
    network = LinearNet(3, bands=size + 100).eval()
    network.fit(rows(values), labels)
    loaded = LinearNet(3, bands=size + 100).eval()
    loaded.load_state_dict(network.state_dict())
    unlike, usual = values.copy(), values[::10].copy()
    unlike[:, :size:4] += 6 * np.sign(unlike[:, :size:4])
    clipped = unlike.clip(values.min(axis=0), values.max(axis=0))
    wave = np.tile([1.0, -1.0], 3)  # its fragments differ, and are moved alike
    given, moved = (torch.from_numpy(x[:, None, :, None] + wave).float() for x in (unlike, clipped))
    usual[:, 7] = 50  # only a fortieth of the features
    network.head.scores.range.take(None)
    torch.testing.assert_close(loaded(given), network(moved), rtol=1e-4, atol=1e-4)
    assert not torch.allclose(network(given), network(moved), atol=0.1)
    for x in (torch.stack(rows(values)), torch.stack(rows(usual))):
        assert torch.equal(loaded(x), network(x))
    state = {key: x for key, x in network.state_dict().items() if ".range." not in key}
    loaded.load_state_dict(state)  # of before
    assert torch.equal(loaded(given), network(given))


def test_levels_and_short_recordings_may_lie_outside_of_the_training():
    inputs, labels = recordings(4)
    inputs = [torch.cat([x] * 4, dim=2) for x in inputs]  # 12 to 24 fragments
    leveled, within = (LinearNet(CLASSES, bands=BANDS, blocks=blocks) for blocks in (SLOW12, None))
    leveled.fit(inputs, labels)
    assert not leveled.head.scores.range.in_use
    within.eval().fit(inputs, labels)
    part: FeatureRange = within.head.scores.range
    for fragments, moves in ((4, False), (5, True)):
        x = torch.full((1, BANDS, 1, fragments), 30.0)
        found = part(x, (x.mean(dim=3), fragments))
        expected = part.highest[None, :, None, None].expand_as(x) if moves else x
        torch.testing.assert_close(found, expected)
    edge = (part.highest * (1 + 1e-6))[None, :, None, None].expand(1, BANDS, 1, 5)
    assert torch.equal(part(edge, (edge.mean(dim=3), 5)), edge)  # outside by rounding alone
    more = torch.stack([part.highest + 1, part.lowest])
    part.take(part.state_dict() | part.widened(more))
    torch.testing.assert_close(part(x, (x.mean(dim=3), 5)), more[:1, :, None, None].expand_as(x))


def noisy_recordings(noise: float, fragments: int, seed: int):
    """Recordings of six classes, whose fragments have so much noise about the mean of the class."""
    rng, labels = np.random.default_rng(seed), torch.arange(6).repeat(10)
    means = np.random.default_rng(0).standard_normal((6, 40))[labels][:, :, None]
    values = 0.3 * means + noise * rng.standard_normal((60, 40, fragments))
    return [torch.from_numpy(x[None]).float() for x in values], labels


@pytest.mark.parametrize("with_pieces", [True, False])
def test_what_is_noisier_than_all_in_training_is_hardly_surer_than_right(with_pieces):
    inputs, labels = noisy_recordings(0.5, 16, seed=1)
    pieces = [(number, x[..., :1]) for number, x in enumerate(inputs)] if with_pieces else ()
    network = LinearNet(6, bands=40).eval()
    network.fit(inputs, labels, pieces=pieces)
    for noise in (0.5, 2.0, 8.0):
        rows, truth = noisy_recordings(noise, 1, seed=2)
        scores = torch.cat([network(x[None]) for x in rows])[:, :, 0]
        right = (scores.argmax(dim=1) == truth).double().mean()
        assert scores.softmax(dim=1).amax(dim=1).mean() < right + 0.15
    usual = torch.cat([network(x[None]) for x in inputs]).softmax(dim=1)
    network.head.scores.reach.take(None)
    torch.testing.assert_close(torch.cat([network(x[None]) for x in inputs]).softmax(dim=1), usual)
    unbounded = torch.cat([network(x[None]) for x in rows])[:, :, 0]
    assert torch.equal(unbounded.argmax(dim=1), scores.argmax(dim=1))
    assert unbounded.softmax(dim=1).amax(dim=1).mean() > right + 0.5


def test_scores_are_sure_up_to_the_longest_piece_of_a_usual_recording_that_passed_the_gate():
    inputs, labels = noisy_recordings(0.5, 16, seed=1)
    inputs = [torch.cat((x, x[:, :1]), dim=1) for x in inputs]  # the last is a band of its own
    hum = torch.tensor([0.0] * 40 + [1e3])[None, :, None]
    pieces = [(n, x[..., :size] + hum) for n, x in enumerate(inputs) for size in (1, 4)]
    network = LinearNet(6, bands=41, bins=[-1] * 40 + [0]).eval()
    network.fit(inputs, labels, pieces=pieces)
    rows = torch.stack([network.features(x[None, ..., :1], "fc2")[0, :40, 0] for x in inputs])
    usual = (rows.square().sum(dim=1) / 41).median()
    torch.testing.assert_close(network.scores.reach.longest, usual, rtol=1e-5, atol=0)


def test_scores_shrink_with_the_squared_length_beyond_the_usual_one():
    part = ScoreReach(2)
    part.fit(torch.tensor([1.0, 4.0, 9.0]), torch.tensor([1.0, 0.25]), factor=2)  # up to 8
    mean = torch.tensor([[2.0, 4.0], [4.0, 8.0], [0.0, 0.0]])  # 8, 32 and 0
    found = part(torch.ones(3, 5, 7), mean)
    assert found[:, 4, 6].tolist() == pytest.approx([1.0, 0.25, 1.0])
    part.take(part.state_dict() | part.widened(mean[:2]))  # of a class that was added
    assert torch.equal(part(torch.ones(3, 5, 7), mean), torch.ones(3, 5, 7))


def test_a_group_is_out_of_range_from_its_limit_on_and_sooner_in_long_recordings():
    gate = RangeGate(torch.tensor([[True, True, False, False], [False, False, True, False]]))
    gate.limits.copy_(torch.tensor([25.0, 4.0]))
    x = torch.tensor([3.0, 3.9, 2.1, 50.0])[None, :, None, None]  # squared lengths 24.2 and 4.4
    assert gate(x)[0, :, 0, 0].tolist() == pytest.approx([3.0, 3.9, 0.0, 50.0])
    assert torch.equal(gate(x * 0.95), x * 0.95)
    gate.fragments.fill_(2)  # the mean of one varies twice as much as that of two
    assert torch.equal(gate(x), x)
    assert gate(x.expand(1, 4, 1, 2))[0, :, 0, 1].tolist() == pytest.approx([3.0, 3.9, 0.0, 50.0])


def test_more_recordings_than_settings_are_chosen_on_make_no_class_less_sure():
    size, count = 60, 4000
    seeded = torch.Generator().manual_seed(9)
    centres, mix = (torch.randn(n, size, generator=seeded) for n in (10, size))
    labels = torch.arange(count + 500) % 10
    noise = torch.randn(count + 500, size, generator=seeded) @ mix / size**0.5
    rows = (centres[labels] + 1.5 * noise)[:, None, :, None]
    network = LinearNet(10, bands=size, blocks=[("shape", size)], strength=0.01)
    network.fit(list(rows[:count]), labels[:count])
    with torch.no_grad():
        shares = torch.cat([network(row[None])[0] for row in rows[count:]], dim=1).softmax(dim=0)
    assert (shares.argmax(dim=0) == labels[count:]).all()
    assert shares.amax(dim=0).mean() > 0.97
