"""MiniRocket: levels, offsets and groups, forged checkpoints, and a run of it."""

import json

import numpy as np
import pytest
import soundfile
import torch
from conftest import make_trace

import tex_lightning as tl

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
