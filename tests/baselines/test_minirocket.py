"""MiniRocket: levels, offsets and groups, forged checkpoints, and a run of it."""

import json

import numpy as np
import pytest
import soundfile
import torch
from aeon.transformations.collection.convolution_based import MiniRocket as MiniRocketOfAeon
from conftest import make_trace

import tex_lightning as tl
from tex_lightning.baselines.classifier import Movement, as_baseline_takes_it
from tex_lightning.errors import UserError

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


def test_one_recording_of_each_class_in_one_session_is_enough(configured):
    """Nothing of a class can be left out then, and the strength is chosen as without groups."""
    traces = [np.sin(np.arange(900) * step) for step in (0.1, 0.5, 1.0)]
    baseline = configured("minirocket", kernels=200)
    baseline.fit(traces, np.arange(3), seed=0, groups=["monday"] * 3)
    assert [int(baseline.logits(trace).argmax()) for trace in traces] == [0, 1, 2]


def turned(kind: int, seed: int) -> np.ndarray:
    """A tone along one axis and noise along another, which one tells the class: (3, 600)."""
    rng = np.random.default_rng(seed)
    tone = np.sin(np.arange(600) * 0.4 + rng.uniform(0, 6)) + 0.1 * rng.standard_normal(600)
    axes = [tone, rng.standard_normal(600), 0.1 * rng.standard_normal(600)]
    return np.stack(axes[:: 1 if kind == 0 else -1]).astype(np.float32)


@pytest.fixture(scope="module")
def of_three_axes(configured):
    baseline = configured("minirocket", kernels=336)
    baseline.fit([turned(n % 2, n) for n in range(16)], np.arange(16) % 2, seed=0)
    return baseline


def test_axes_are_convolved_one_by_one(configured, of_three_axes):
    """Joined to one axis by DFT321, both classes have the same spectrum."""
    traces = [turned(n % 2, n) for n in range(16)]
    centred = [x - x.mean(axis=1, keepdims=True) for x in traces]
    whole = np.stack([x / x.std() for x in centred])
    aeons = MiniRocketOfAeon(n_kernels=336, random_state=0)
    np.testing.assert_array_equal(
        of_three_axes.estimator[0].transform(whole), aeons.fit_transform(whole)
    )
    new = [turned(n % 2, 100 + n) for n in range(20)]
    assert [int(of_three_axes.logits(trace).argmax()) for trace in new] == [0, 1] * 10
    again = configured("minirocket", kernels=336)
    again.load_state(of_three_axes.state())
    torch.testing.assert_close(again.logits(new[0]), of_three_axes.logits(new[0]))


def test_a_sense_gives_several_axes_to_those_who_take_them():
    trace = torch.from_numpy(turned(0, 0))
    apart, joined = (Movement(False, 100, apart=apart)(trace) for apart in (True, False))
    assert (apart.shape, joined.shape) == ((1, 3, 600), (1, 1, 600))
    torch.testing.assert_close(apart[0], trace - trace.mean(dim=1, keepdim=True))
    assert as_baseline_takes_it(apart).shape == (3, 600)
    assert as_baseline_takes_it(joined).shape == (600,)


def test_another_number_of_axes_is_refused(of_three_axes, fitted_once):
    with pytest.raises(UserError, match="has 1 axes, and MiniRocket was trained on 3; give"):
        of_three_axes.logits(TRACES[0])
    with pytest.raises(UserError, match="has 3 axes, and MiniRocket was trained on 1; give"):
        fitted_once[0].logits(turned(0, 0))


def test_checkpoints_of_before_are_of_one_axis(fitted_once, configured):
    state = fitted_once[0].state()
    del state["axes"]
    again = configured("minirocket", kernels=168)
    again.load_state(state)
    torch.testing.assert_close(again.logits(TRACES[0]), fitted_once[0].logits(TRACES[0]))


@pytest.mark.parametrize(
    ("part", "change"),
    [
        (0, lambda added: added[:-1]),
        (0, lambda added: 0 * added),
        (0, lambda added: 9 * added),
        (1, lambda indices: indices + 1),
        (1, lambda indices: indices - 1),
        (2, lambda dilations: -dilations),
        (2, lambda dilations: dilations * 10_000),
        (2, lambda dilations: dilations.astype(np.int64)),
        (3, lambda counts: counts * 1000),
        (3, lambda counts: counts[None]),
        (4, lambda biases: biases[:-1]),
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
    with pytest.raises(ValueError, match=r"another|longer|other axes"):
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


@pytest.fixture(scope="module")
def checkpoint(run_once, surfaces):
    return run_once(
        "model=minirocket", "model.baseline.kernels=840", "data=folder", f"data.root={surfaces}"
    ) / ("checkpoints/haptic.ckpt")


def test_results_name_the_modality_and_the_checkpoint_holds_tensors(checkpoint):
    results = json.loads((checkpoint.parents[1] / "results.json").read_text())
    network = results["networks"]["haptic"]
    assert results["model"] == "minirocket"
    assert network["correct"] == network["test_samples"] == 3
    assert network["macs_per_sample"] is None
    content = torch.load(checkpoint, weights_only=True)
    assert content["baseline"]["estimator"].dtype == torch.uint8


def test_predict_and_evaluate_read_the_checkpoint(checkpoint, surfaces, cli, tmp_path):
    trace = surfaces / "beta/haptic/beta_0.wav"
    out = cli("task=predict", f"checkpoint={checkpoint}", f"haptic={trace}").out
    line = json.loads(out)
    assert line["label"] == "beta"
    found = tl.load(checkpoint).predict(haptic=trace)
    assert (found.label, found.probability) == ("beta", line["probability"])
    stream, (samples, _) = tl.load(checkpoint).stream(), soundfile.read(trace)
    assert [stream.push(samples[:9]).label, stream.push(samples[9:]).label] == [None, "beta"]
    outcome = cli(
        "task=evaluate", f"checkpoint={checkpoint}", "data=folder", f"data.root={surfaces}",
        "data.test_fold=0", f"hydra.run.dir={tmp_path}",
    )  # fmt: skip
    assert outcome.status == 0, outcome.err
