"""How MiniRocket takes traces: what their level, offset and length do to its scores."""

import numpy as np
import pytest
import torch
from conftest import make_trace

LABELS = np.repeat(np.arange(3), 4)
TRACES = [make_trace(kind, index, seconds=0.9) for kind in range(3) for index in range(4)]


@pytest.mark.parametrize("keep_level", [False, True])
def test_the_level_counts_where_it_is_kept_and_the_offset_never(configured, keep_level):
    baseline = configured("minirocket", kernels=168, keep_level=keep_level)
    baseline.fit(TRACES, LABELS, seed=0)
    trace = TRACES[0]
    same = torch.allclose(baseline.logits(trace), baseline.logits(4 * trace), atol=1e-4)
    assert same is not keep_level
    torch.testing.assert_close(
        baseline.logits(trace + 0.5), baseline.logits(trace), rtol=1e-3, atol=1e-2
    )


def test_the_strength_is_chosen_on_groups_that_are_left_out(configured):
    rng = np.random.default_rng(0)
    groups = np.repeat(np.arange(12), 3)  # of noise, which tells nothing of its class
    noises = [np.random.default_rng(group).standard_normal(900) for group in groups]
    traces = [(noise + 0.01 * rng.standard_normal(900)).astype(np.float32) for noise in noises]
    baseline = configured("minirocket", kernels=168)
    baseline.fit(traces, groups % 2, seed=0, groups=groups.tolist())
    ridge = baseline.estimator[-1]
    assert 0 < ridge.best_score_ < 0.9  # a share of traces; pieces of one another are all right
    again = configured("minirocket", kernels=168)
    again.load_state(baseline.state())
    torch.testing.assert_close(again.logits(traces[0]), baseline.logits(traces[0]))


@pytest.mark.parametrize(
    ("part", "change"),
    [
        (2, lambda dilations: -dilations),
        (2, lambda dilations: dilations * 10_000),
        (2, lambda dilations: dilations[:-1]),
        (2, lambda dilations: dilations.astype(np.int64)),
        (3, lambda counts: -counts),
        (3, lambda counts: counts * 1000),
        (3, lambda counts: counts[None]),
        (4, lambda biases: biases[:-1]),
        (4, lambda biases: biases[:0]),
    ],
)
def test_a_forged_transform_is_refused_before_compiled_code_sees_it(fitted_once, part, change):
    baseline, again = fitted_once
    transform = baseline.estimator[0]
    kept = transform.parameters
    forged = list(kept)
    forged[part] = change(forged[part])
    transform.parameters = tuple(forged)
    state = baseline.state()
    transform.parameters = kept
    with pytest.raises(ValueError, match=r"another|longer"):
        again.load_state(state)


@pytest.mark.parametrize("length", [-1, 8, 1 << 40])
def test_a_forged_length_is_refused(fitted_once, length):
    baseline, again = fitted_once
    with pytest.raises(ValueError, match=r"length|longer"):
        again.load_state({**baseline.state(), "length": torch.tensor(length)})


@pytest.fixture(scope="module")
def fitted_once(configured):
    baseline = configured("minirocket", kernels=168)
    baseline.fit(TRACES, LABELS, seed=0)
    return baseline, configured("minirocket", kernels=168)
