"""What every haptic baseline promises: fit, save, load, unequal lengths."""

import numpy as np
import pytest
import torch
from conftest import make_trace
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.svm import LinearSVC

from tex_lightning.baselines.base import class_scores

# settings that make each quick; the rest is as configured
QUICK = {
    "mfcc_nb": {},
    "mfcc_gmm": {"components": 2},
    "acnn": {"fragment_seconds": 0.4, "steps": 30, "patches": 300, "batch_size": 9},
    "minirocket": {"kernels": 168},
}
LABELS = np.repeat(np.arange(3), 4)


@pytest.fixture(scope="module", params=QUICK)
def fitted(request, configured):
    """A baseline fitted to traces of unequal length."""
    traces = [
        make_trace(kind, index, seconds=0.9 + 0.05 * index)
        for kind in range(3)
        for index in range(4)
    ]
    baseline = configured(request.param, **QUICK[request.param])
    baseline.fit(traces, LABELS, seed=0)
    return request.param, baseline, traces


def test_unseen_traces_of_other_lengths_are_told_apart(fitted):
    _, baseline, _ = fitted
    for kind in range(3):
        for seconds in (0.6, 1.4):
            scores = baseline.logits(make_trace(kind, 9, seconds))
            assert scores.ndim == 2
            assert int(scores.float().softmax(dim=0).mean(dim=1).argmax()) == kind


def test_scores_are_equal_after_loading(fitted, tmp_path, configured):
    name, baseline, traces = fitted
    torch.save(baseline.state(), tmp_path / "state.pt")
    again = configured(name, **QUICK[name])
    again.load_state(torch.load(tmp_path / "state.pt", weights_only=True))
    assert again.count_parameters() == baseline.count_parameters() > 0
    for trace in (traces[0], traces[5][:3000]):
        torch.testing.assert_close(again.logits(trace), baseline.logits(trace), rtol=0, atol=0)


def test_fitting_again_gives_the_same_and_leaves_the_generator_alone(fitted, configured):
    name, baseline, traces = fitted
    before, threads = torch.get_rng_state(), torch.get_num_threads()
    again = configured(name, **QUICK[name])
    again.fit(traces, LABELS, seed=0)
    torch.testing.assert_close(again.logits(traces[1]), baseline.logits(traces[1]))
    assert torch.equal(torch.get_rng_state(), before)
    assert torch.get_num_threads() == threads


@pytest.mark.parametrize("classes", [2, 3])
@pytest.mark.parametrize("estimator", [GaussianNB(), KNeighborsClassifier(1), LinearSVC()])
def test_scores_of_scikit_learn_are_finite_and_in_the_order_of_classes(estimator, classes):
    labels = np.arange(30) % classes
    rows = np.random.default_rng(0).standard_normal((30, 4)) + 9 * np.eye(4)[labels]
    scores = class_scores(estimator.fit(rows, labels), rows)
    assert scores.shape == (classes, 30)
    assert torch.isfinite(scores).all()
    np.testing.assert_array_equal(scores.argmax(0), labels)
