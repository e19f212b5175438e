"""The table of metrics: how each is computed, named and formatted.

A new figure is one line of :data:`METRICS` with a function of the outcomes. It is then in
``results.json``, in the tables of runs, sweeps and reports, in ``sweep.csv`` and ``frontier.csv``,
in the folds of a cross-validation, and with the loggers.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Any, Literal

import torch

from tex_lightning.evaluation.calibration import calibration
from tex_lightning.evaluation.confusion import vote_counts
from tex_lightning.evaluation.outcomes import Outcome, summarise

TOP = (2, 3, 5)  # classes among which the true one may be
MEGA = 1e6
Group = Literal["votes", "scores", "costs"]
Place = Literal["summary", "comparison", "sweep", "trials", "folds", "frontier"]
EVERYWHERE: tuple[Place, ...] = ("summary", "comparison", "sweep", "trials", "folds", "frontier")
RUNS: tuple[Place, ...] = ("summary", "comparison", "sweep")


@dataclass(frozen=True)
class Metric:
    """One figure of a network.

    Attributes:
        name: Column of a CSV.
        path: Dotted keys in the network's entry of ``results.json``; empty means the entry.
        heading: Of a column or line of a table for people.
        compute: Gives the figure of some outcomes, or None where it means nothing; None where
            :func:`pooled_metrics` computes it with others, or the network has it.
        form: Format of the figure for people, or what makes it text.
        group: Place among the lines of a network: its votes, other scores, or costs.
        logged: ``test/NAME`` of loggers; empty means the name, None leaves it out.
        places: Tables that have it: the ``summary`` of a run, the ``comparison`` of systems,
            ``sweep.csv``, the ``trials`` of a sweep for people, the ``folds`` of a
            cross-validation, and ``frontier.csv``.
    """

    name: str
    path: str
    heading: str
    compute: Callable[[Sequence[Outcome]], float | None] | None = None
    form: str | Callable[[Any], str] = ".1%"
    group: Group = "scores"
    logged: str | None = ""
    places: tuple[Place, ...] = EVERYWHERE

    def of(self, entry: Mapping[str, Any]) -> Any:  # noqa: ANN401
        """Return the figure of an entry; None where it has none."""
        value: Any = entry
        for key in filter(None, self.path.split(".")):
            if isinstance(value, Mapping):
                value = value.get(key)
            else:  # an end of an interval
                value = value[int(key)] if isinstance(value, Sequence) else None
        return value

    def told(self, entry: Mapping[str, Any]) -> str:
        """Return the figure of an entry as text; empty where it has none."""
        return self.text(self.of(entry))

    def text(self, value: Any) -> str:  # noqa: ANN401
        """Return a figure as text; empty for None."""
        if value is None:
            return ""
        return self.form(value) if callable(self.form) else format(value, self.form)


def counts_text(entry: Mapping[str, Any]) -> str:
    """Return the counts of an entry as text; empty where nothing was tested."""
    return f"{entry['correct']}/{entry['test_samples']}" if "correct" in entry else ""


def _millions(count: float) -> str:
    """Return a count in millions; of less than ten also the digits after the point that it has."""
    return f"{count / MEGA:,.0f}" if count >= 10 * MEGA else f"{count / MEGA:.2g}"


def _mean_macs(outcomes: Sequence[Outcome]) -> float | None:
    """Return the share of the arithmetic that sequential decisions did; None without any."""
    shares = [outcome.relative_macs for outcome in outcomes]
    return fmean(shares) if any(share != 1 for share in shares) else None


METRICS = {
    metric.name: metric
    for metric in (
        Metric("vote_accuracy", "vote_accuracy", "accuracy", group="votes",
               places=("summary", "sweep", "folds", "frontier")),
        Metric("counts", "", "correct", form=counts_text, group="votes", logged=None,
               places=("summary",)),
        Metric("vote_ci95", "vote_ci95", "95 % interval", group="votes", logged=None,
               form=lambda ends: "{:.1%} to {:.1%}".format(*ends), places=("summary",)),
        Metric("ci_low", "vote_ci95.0", "at least", group="votes", logged="vote_ci95_low",
               places=("sweep", "frontier")),
        Metric("ci_high", "vote_ci95.1", "at most", group="votes", logged="vote_ci95_high",
               places=("sweep", "frontier")),
        Metric("correct", "correct", "correct", form=",.0f", group="votes", logged=None,
               places=("sweep",)),
        Metric("test_samples", "test_samples", "test samples", form=",.0f", group="votes",
               logged="samples", places=("sweep", "folds")),
        Metric("balanced_accuracy", "balanced_accuracy", "balanced accuracy", places=RUNS),
        Metric("macro_f1", "macro_f1", "macro F1", places=RUNS),
        *(
            Metric(f"top_{k}_accuracy", f"top_k_accuracy.{k}", f"among the first {k}",
                   places=("summary", "sweep") if k == TOP[1] else ("sweep",))
            for k in TOP
        ),
        *(
            Metric(name, f"calibration.{name}", heading, form=".3f", places=())
            for name, heading in (("ece", "ECE"), ("brier", "Brier score"), ("nll", "NLL"))
        ),
        Metric("novelty_auroc", "unknown.novelty_auroc", "AUROC of unknown", form=".3f",
               places=("sweep", "trials")),
        *(
            Metric(name, f"unknown.{name}.share", name.replace("_", " "),
                   places=("sweep", "trials"))
            for name in ("false_rejections", "accepted_unknown")
        ),
        Metric("fragment_accuracy", "fragment_accuracy", "fragments", group="costs",
               places=(*RUNS, "folds")),
        Metric("latency_ms", "latency_ms.median", "ms/sample", form=".1f", group="costs",
               places=(*RUNS, "frontier")),
        Metric("latency_ms_p95", "latency_ms.p95", "ms/sample, p95", form=".1f", group="costs",
               logged=None, places=("frontier",)),
        Metric("fit_seconds", "fit_seconds", "fit s", form=".1f", group="costs"),
        Metric("parameters", "parameters", "parameters", form=",.0f", group="costs", logged=None,
               places=("summary", "comparison", "frontier")),
        Metric("macs_per_sample", "macs_per_sample", "MMAC/sample", form=_millions,
               group="costs", logged=None, places=("summary", "frontier")),
        Metric("relative_macs", "relative_macs", "arithmetic", _mean_macs, group="costs",
               logged=None, places=()),
        Metric("val_loss", "val_loss", "val_loss", form=".4g", group="costs", logged=None,
               places=("sweep",)),
    )
}  # fmt: skip


def metrics_in(place: Place, *groups: Group) -> list[Metric]:
    """Return the metrics of a table, in order; of some groups alone if any are given."""
    return [
        metric
        for metric in METRICS.values()
        if place in metric.places and (not groups or metric.group in groups)
    ]


def figures(entry: Mapping[str, Any], metrics: Iterable[Metric]) -> dict[str, Any]:
    """Return the figures of an entry of ``results.json`` by name, those that it has."""
    values = {metric.name: metric.of(entry) for metric in metrics}
    return {name: value for name, value in values.items() if value is not None}


def told(entry: Mapping[str, Any], metrics: Iterable[Metric]) -> dict[str, str]:
    """Return the same as text, by heading."""
    return {metric.heading: text for metric in metrics if (text := metric.told(entry))}


def logged_figures(entry: Mapping[str, Any]) -> dict[str, float]:
    """Return what loggers are given of an entry, as ``test/NAME``."""
    logged = [metric for metric in METRICS.values() if metric.logged is not None]
    values = {f"test/{metric.logged or metric.name}": metric.of(entry) for metric in logged}
    return {name: value for name, value in values.items() if value is not None}


def pooled_metrics(outcomes: Sequence[Outcome], *, calibrated: bool = True) -> dict[str, Any]:
    """Return entries of ``results.json`` that follow from the outcomes of some folds.

    Args:
        outcomes: Outcomes of at least one sample.
        calibrated: Whether calibration is among them, which takes the probabilities of each sample;
            files of earlier versions lack those.
    """
    entry = {**summarise(outcomes), **class_metrics(outcomes)}
    if calibrated:
        entry["calibration"] = calibration(outcomes)
    for metric in METRICS.values():
        value = None if metric.compute is None else metric.compute(outcomes)
        if value is not None:
            *parents, key = metric.path.split(".")
            inner = entry
            for parent in parents:
                inner = inner.setdefault(parent, {})
            inner[key] = value
    return entry


def class_metrics(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Return metrics in which every class counts alike, and those of the classes that come next.

    A class without test samples has no recall, and counts for none of the means. The first class of
    a sample is its label, the others follow by their mean probability.

    Returns:
        ``balanced_accuracy``, the mean recall; ``macro_f1``; ``recall`` by class;
        ``top_k_accuracy`` by k, of those below the number of classes. Of no samples the means are
        None.
    """
    if not outcomes:
        return {"balanced_accuracy": None, "macro_f1": None, "recall": {}, "top_k_accuracy": {}}
    known = {name: None for outcome in outcomes for name in outcome.class_probabilities}
    seen = {name: None for outcome in outcomes for name in (outcome.label, outcome.predicted)}
    classes = [*{**known, **seen}]
    counts = torch.from_numpy(vote_counts(outcomes, classes)).double()
    right, support, called = counts.diagonal(), counts.sum(dim=1), counts.sum(dim=0)
    recall = right / support.clamp(min=1)
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
