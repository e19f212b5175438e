"""Metrics of whole samples against scikit-learn, and Lightning's own test and prediction."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from lightning import Trainer
from own_parts import MemoryLogger
from sklearn.metrics import accuracy_score, confusion_matrix, roc_auc_score

from tex_lightning.classifier.vote import Vote, max_vote
from tex_lightning.config import Folding
from tex_lightning.data.datamodule import SampleSet, SurfaceData
from tex_lightning.data.folds import make_samples, split
from tex_lightning.data.readers.folder import read_folder
from tex_lightning.data.store import Store
from tex_lightning.evaluation.outcomes import read_outcomes
from tex_lightning.learning.base import SurfaceModule, update_metrics, vote_metrics
from tex_lightning.learning.trainer import quiet_lightning


def votes(samples: int, classes: int) -> tuple[list[Vote], list[int]]:
    """Decisions on samples of which the first has a single fragment, and true classes.

    The last class has no sample.
    """
    generator = torch.Generator().manual_seed(0)
    labels = [number % (classes - 1) for number in range(samples)]
    scores = [torch.randn(classes, 1 + 3 * n, generator=generator) for n in range(samples)]
    for label, logits in zip(labels, scores, strict=True):
        logits[label] += 1
    return [max_vote(logits) for logits in scores], labels


def test_metrics_of_samples_are_scikit_learns():
    made, labels = votes(30, 4)
    metrics = vote_metrics(4, "test")
    for vote, label in zip(made, labels, strict=True):
        update_metrics(metrics, vote, torch.tensor(label))
    found = metrics.compute()
    won = [vote.label for vote in made]
    assert 0 < accuracy_score(labels, won) < 1
    assert float(found["test/vote_accuracy"]) == pytest.approx(accuracy_score(labels, won))
    fragments = np.concatenate([vote.fragments for vote in made])
    repeated = np.repeat(labels, [len(vote.fragments) for vote in made])
    expected = accuracy_score(repeated, fragments)
    assert float(found["test/fragment_accuracy"]) == pytest.approx(expected)
    np.testing.assert_array_equal(
        found["test/confusion"], confusion_matrix(labels, won, labels=range(4))
    )
    probabilities = np.stack([vote.probabilities for vote in made])
    pooled = roc_auc_score(np.eye(4)[labels], probabilities, average="micro")
    assert float(found["test/auroc"]) == pytest.approx(pooled, abs=2e-3)


def test_a_probability_rounded_beyond_1_is_no_logit():
    probabilities = torch.tensor([1 + 2e-16, 0], dtype=torch.float64)
    sure = Vote(0, torch.tensor([1.0, 0]), torch.tensor([0]), probabilities)
    metrics = vote_metrics(2, "val")
    update_metrics(metrics, sure, torch.tensor(0))
    assert float(metrics.compute()["val/ece"]) == 0


@pytest.fixture(scope="module")
def run(run_once, surfaces) -> Path:
    return run_once(
        "model=haptic", "data=folder", f"data.root={surfaces}", "debug=tiny", "trainer.threads=1"
    )


def test_lightning_tests_and_predicts_a_checkpoint_as_the_package_does(run, surfaces, cache):
    checkpoint = run / "checkpoints" / "haptic.ckpt"
    module = SurfaceModule.load_from_checkpoint(checkpoint, weights_only=True)
    card = module.classifier.card
    store = Store(cache, {"haptic": module.classifier.senses["haptic"].decoder})
    samples = make_samples(
        split(read_folder(surfaces), Folding(10, 0, None, False, None)).test, ["haptic"]
    )
    none, test = (SampleSet(each, store, card.classes) for each in ([], samples))
    data = SurfaceData(None, 0, none, test, 0)
    logger = MemoryLogger("lightning")
    with quiet_lightning():
        trainer = Trainer(
            accelerator="cpu", logger=logger, enable_progress_bar=False, enable_model_summary=False
        )
        (tested,) = trainer.test(module, datamodule=data, verbose=False)
        predicted = trainer.predict(module, datamodule=data)
    entry = json.loads((run / "results.json").read_text())["networks"]["haptic"]
    for name in ("vote_accuracy", "fragment_accuracy"):
        assert tested[f"test/{name}"] == pytest.approx(entry[name])
    assert tested["test/ece"] == pytest.approx(entry["calibration"]["ece"], abs=1e-4)
    assert logger.images.keys() == {"test/confusion"}
    outcomes = read_outcomes(run / "predictions" / "haptic.csv")
    assert [card.classes[vote["label"]] for vote in predicted] == [
        each.predicted for each in outcomes
    ]
