"""Metrics of a test against scikit-learn, and that each is found where the table says."""

import json
from dataclasses import replace
from statistics import fmean

import numpy as np
import pytest
from sklearn.metrics import balanced_accuracy_score, f1_score, recall_score, top_k_accuracy_score

from tex_lightning.core.files import read_rows
from tex_lightning.evaluation.metrics import (
    METRICS,
    Metric,
    class_metrics,
    figures,
    metrics_in,
    pooled_metrics,
    told,
)
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.table import facts

CLASSES = [*"abcdefg"]


def outcomes_of(truth, probabilities):
    return [
        Outcome({"haptic": str(n)}, CLASSES[label], CLASSES[row.argmax()], 1.0, 1, 1, 1.0,
                probabilities=json.dumps(dict(zip(CLASSES, row.tolist(), strict=True))))
        for n, (label, row) in enumerate(zip(truth, probabilities, strict=True))
    ]  # fmt: skip


@pytest.mark.parametrize("tested", [7, 4, 1])
def test_metrics_are_those_of_scikit_learn_also_where_classes_are_not_tested(tested):
    rng = np.random.default_rng(tested)
    truth = rng.integers(0, tested, 60) ** 2 // tested  # some classes have more than others
    probabilities = rng.dirichlet(np.ones(7), 60) + 0.2 * np.eye(7)[truth]
    found = class_metrics(outcomes_of(truth, probabilities))
    labels = probabilities.argmax(axis=1)
    present = np.unique(truth)
    recall = recall_score(truth, labels, average=None, labels=present)
    assert found["recall"] == pytest.approx(
        {CLASSES[label]: share for label, share in zip(present, recall, strict=True)}
    )
    assert found["balanced_accuracy"] == pytest.approx(recall.mean())
    if set(labels) <= set(truth):  # scikit-learn warns of others
        assert found["balanced_accuracy"] == pytest.approx(balanced_accuracy_score(truth, labels))
    assert found["macro_f1"] == pytest.approx(f1_score(truth, labels, average="macro"))
    for k in (2, 3, 5):
        share = top_k_accuracy_score(truth, probabilities, k=k, labels=range(7))
        assert found["top_k_accuracy"][str(k)] == pytest.approx(share)


def test_the_label_is_the_first_of_the_top_classes_whatever_decides():
    probable = json.dumps({"a": 0.5, "b": 0.3, "c": 0.2})
    outcome = Outcome({"haptic": ""}, "a", "b", 1.0, 1, 0, 1.0, probabilities=probable)
    assert class_metrics([outcome])["top_k_accuracy"] == {"2": 1.0}
    other = Outcome({"haptic": ""}, "a", "c", 1.0, 1, 0, 1.0, probabilities=probable)
    assert class_metrics([outcome, other])["top_k_accuracy"] == {"2": 1.0}
    last = Outcome({"haptic": ""}, "b", "c", 1.0, 1, 0, 1.0, probabilities=probable)
    assert class_metrics([last])["top_k_accuracy"] == {"2": 0.0}


def test_metrics_of_no_samples_are_not_defined():
    nothing = {"balanced_accuracy": None, "macro_f1": None, "recall": {}, "top_k_accuracy": {}}
    assert class_metrics([]) == nothing
    assert told(nothing, METRICS.values()) == {}


def test_every_figure_of_a_run_is_found_where_the_table_says(bands):
    (entry,) = json.loads((bands / "results.json").read_text())["networks"].values()
    absent = {name for name, metric in METRICS.items() if metric.of(entry) is None}
    assert absent == ABSENT
    assert [METRICS["ci_low"].of(entry), METRICS["ci_high"].of(entry)] == entry["vote_ci95"]
    assert told(entry, [METRICS["vote_accuracy"]]) == {"accuracy": f"{entry['vote_accuracy']:.1%}"}
    assert METRICS["val_loss"].told({"val_loss": None}) == ""


# Of three classes, of every fragment and of a fit that rejects nothing, there are none of these
ABSENT = {
    "top_3_accuracy", "top_5_accuracy", "relative_macs", "novelty_auroc", "false_rejections",
    "accepted_unknown",
}  # fmt: skip


def test_what_is_called_unknown_is_in_the_tables_of_a_sweep():
    entry = {
        "vote_accuracy": 0.5,
        "unknown": {
            "novelty_auroc": 0.75,
            "false_rejections": {"count": 1, "of": 4, "share": 0.25},
            "accepted_unknown": None,
        },
    }
    expected = {"novelty_auroc": 0.75, "false_rejections": 0.25}
    assert expected.items() <= figures(entry, metrics_in("sweep")).items()
    assert told(entry, metrics_in("trials")) == {
        "AUROC of unknown": "0.750", "false rejections": "25.0%"
    }  # fmt: skip


def test_the_arithmetic_of_small_networks_is_not_nothing():
    told_of = METRICS["macs_per_sample"].text
    counts = (248_876, 9_420_000, 123_456_000_000)
    assert [told_of(count) for count in counts] == ["0.25", "9.4", "123,456"]


def test_the_results_of_a_sequential_decision_say_how_much_it_computed():
    full = outcomes_of([0, 1], np.eye(7)[:2])
    outcomes = [replace(full[0], relative_macs=0.5), full[1]]
    assert pooled_metrics(outcomes)["relative_macs"] == 0.75
    assert "relative_macs" not in pooled_metrics(outcomes[1:])


@pytest.mark.slow
def test_a_new_figure_is_one_line(cli, tiny, tmp_path, monkeypatch):
    """It is in results, folds, tables, reports, CSVs and loggers, nested where its path says."""
    sure = Metric("sure", "further.sure", "sure samples", lambda outcomes: fmean(
        outcome.share > 0.5 for outcome in outcomes), form=".2f")  # fmt: skip
    monkeypatch.setitem(METRICS, "sure", sure)

    def run(name, *arguments):
        outcome = cli(*arguments, *tiny, f"hydra.run.dir={tmp_path / name}")
        assert outcome.status == 0, outcome.err
        return tmp_path / name

    def results(folder):
        return json.loads((folder / "results.json").read_text())

    folder = run("cv", "task=crossval", "model=mfcc_nb", "crossval.only=[0,3]", "logger=csv")
    (entry,) = results(folder)["networks"].values()
    share = entry["further"]["sure"]
    assert 0 <= share <= 1
    assert all(0 <= fold["sure"] <= 1 for fold in entry["folds"])
    assert facts(results(folder))["haptic"]["sure samples"] == f"{share:.2f}"  # of the terminal
    for page in ("report.html", "report.md"):
        assert "sure samples" in (folder / page).read_text()
    (logged,) = read_rows(folder / "metrics" / "haptic" / "metrics.csv")
    assert float(logged["test/sure"]) == share
    filters = "model.baseline.filters=18,20"
    folder = run("sweep", "-m", f"hydra.sweep.dir={tmp_path}/sweep", "model=mfcc_nb", filters)
    jobs = [row for row in read_rows(folder / "sweep.csv") if row["job"] in "01"]
    entries = [results(folder / job)["networks"]["haptic"] for job in "01"]
    assert [float(row["sure"]) for row in jobs] == [it["further"]["sure"] for it in entries]
    assert (folder / "report.md").read_text().count("sure samples") == 2  # jobs, then systems
    only = ("frontier.only=[mfcc_nb]", "crossval.only=[0,3]")
    folder = run("frontier", "task=frontier", *only)
    (row,) = read_rows(folder / "frontier.csv")
    assert float(row["sure"]) == share
