"""The metrics of a test: where ``results.json`` has each, and how tables and loggers call it."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import torch

from tex_lightning.evaluation.outcomes import Outcome

TOP = (2, 3, 5)  # classes among which the true one may be
MEGA = 1e6


class Metric(NamedTuple):
    """One figure of a network.

    Attributes:
        name: Column of ``sweep.csv``, and ``test/NAME`` of loggers.
        path: Dotted keys in the network's entry of ``results.json``.
        heading: Of a column or line of a table for people.
        form: Format of the figure there.
        scale: The figure is divided by it there.
    """

    name: str
    path: str
    heading: str
    form: str = ".1%"
    scale: float = 1.0

    def of(self, entry: Mapping[str, Any]) -> float | None:
        """Return the figure of an entry; None where it has none."""
        found: Any = entry
        for key in self.path.split("."):
            found = found.get(key) if isinstance(found, Mapping) else None
        figure: float | None = found
        return figure

    def told(self, entry: Mapping[str, Any]) -> str:
        """Return the figure as text; empty where there is none."""
        found = self.of(entry)
        return "" if found is None else format(found / self.scale, self.form)


METRICS = {
    metric.name: metric
    for metric in (
        Metric("vote_accuracy", "vote_accuracy", "accuracy"),
        Metric("correct", "correct", "correct", ",.0f"),
        Metric("test_samples", "test_samples", "test samples", ",.0f"),
        Metric("balanced_accuracy", "balanced_accuracy", "balanced accuracy"),
        Metric("macro_f1", "macro_f1", "macro F1"),
        *(Metric(f"top_{k}_accuracy", f"top_k_accuracy.{k}", f"among the first {k}") for k in TOP),
        Metric("fragment_accuracy", "fragment_accuracy", "fragments"),
        Metric("latency_ms", "latency_ms.median", "ms/sample", ".1f"),
        Metric("fit_seconds", "fit_seconds", "fit s", ".1f"),
        Metric("parameters", "parameters", "parameters", ",.0f"),
        Metric("macs_per_sample", "macs_per_sample", "MMAC/sample", ",.0f", MEGA),
        Metric("val_loss", "val_loss", "val_loss", ".4g"),
    )
}
SCORES = (  # of loggers and sweep.csv, beside calibration
    "vote_accuracy", "balanced_accuracy", "macro_f1", *(f"top_{k}_accuracy" for k in TOP),
    "fragment_accuracy", "latency_ms", "fit_seconds",
)  # fmt: skip


def figures(entry: Mapping[str, Any], names: Iterable[str]) -> dict[str, float]:
    """Return the figures of an entry of ``results.json`` by name, those that it has."""
    found = {name: METRICS[name].of(entry) for name in names}
    return {name: figure for name, figure in found.items() if figure is not None}


def told(entry: Mapping[str, Any], names: Iterable[str]) -> dict[str, str]:
    """Return the same as text, by heading."""
    metrics = (METRICS[name] for name in names)
    return {metric.heading: text for metric in metrics if (text := metric.told(entry))}


def class_metrics(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return metrics in which every class counts alike, and those of the classes that come next.

    A class without test samples has no recall, and counts for none of the means. The first class of
    a sample is its label, the others follow by their mean probability.

    Args:
        outcomes: Of at least one sample.

    Returns:
        ``balanced_accuracy``, the mean recall; ``macro_f1``; ``recall`` by class;
        ``top_k_accuracy`` by k, of those below the number of classes.
    """
    # slow to import, and of tests alone
    from torchmetrics.functional.classification import multiclass_stat_scores

    known = {name: None for outcome in outcomes for name in outcome.class_probabilities}
    seen = {name: None for each in outcomes for name in (each.label, each.predicted)}
    classes = [*{**known, **seen}]
    index = {name: number for number, name in enumerate(classes)}
    truth = torch.tensor([index[outcome.label] for outcome in outcomes])
    found = torch.tensor([index[outcome.predicted] for outcome in outcomes])
    count = max(2, len(classes))
    counts = multiclass_stat_scores(found, truth, count, average=None).double()
    right, wrongly, _, _, support = counts.unbind(dim=1)  # exact, as float32 shares are not
    recall, called = right / support.clamp(min=1), right + wrongly
    of_class = {classes[i]: float(recall[i]) for i in support.nonzero()[:, 0].tolist()}
    f1 = (2 * right / (support + called).clamp(min=1))[support + called > 0].mean()
    ranks = [_rank(outcome) for outcome in outcomes] if known else []
    top = {str(k): sum(rank < k for rank in ranks) / len(ranks) for k in TOP if k < len(known)}
    return {
        "balanced_accuracy": float(recall[support > 0].mean()),
        "macro_f1": float(f1),
        "recall": of_class,
        "top_k_accuracy": top,
    }


def _rank(outcome: Outcome) -> int:
    """Return how many classes stand before the true one."""
    probable = outcome.class_probabilities
    first = sorted(probable, key=lambda name: (name != outcome.predicted, -probable[name]))
    return first.index(outcome.label) if outcome.label in probable else len(first)
