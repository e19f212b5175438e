"""Comparison of decisions that stop early with the full ones, over their thresholds."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.config import DecisionConfig
from tex_lightning.core.files import read_rows, write_lines
from tex_lightning.core.progress import track
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.evaluation.samples import classify_sample
from tex_lightning.inference.early_stopping import SequentialClassifier


@dataclass(frozen=True)
class Setting:
    """Results of one threshold on the test samples.

    Attributes:
        network: Its sense, or ``fusion``.
        knob: ``alpha``, ``confidence_threshold``, or ``used`` for the thresholds of the run.
        value: Value of the threshold; for ``used`` that of alpha.
        test_samples: Their number.
        correct: Right votes.
        agreed: Votes that are those of the full decision.
        relative_macs: Mean share of the full decision's arithmetic.
        fragments: Mean number of fragments.
    """

    network: str
    knob: str
    value: float
    test_samples: int
    correct: int
    agreed: int
    relative_macs: float
    fragments: float


def pool(settings: Iterable[Setting]) -> list[Setting]:
    """Add up the same thresholds over folds."""
    pooled: dict[tuple[str, str, float], Setting] = {}
    for new in settings:
        key = (new.network, new.knob, new.value)
        pooled[key] = _sum(pooled[key], new) if key in pooled else new
    return list(pooled.values())


def _sum(old: Setting, new: Setting) -> Setting:
    count = old.test_samples + new.test_samples
    share = new.test_samples / count
    return replace(
        old,
        test_samples=count,
        correct=old.correct + new.correct,
        agreed=old.agreed + new.agreed,
        relative_macs=(1 - share) * old.relative_macs + share * new.relative_macs,
        fragments=(1 - share) * old.fragments + share * new.fragments,
    )


def summarise_sequential(used: Setting) -> dict[str, Any]:
    """The entry of ``results.json``."""
    count = used.test_samples
    return {
        "relative_macs": used.relative_macs,
        "fragments": used.fragments,
        "accuracy": used.correct / count,
        "agreement": used.agreed / count,
        "agreement_ci95": wilson_interval(used.agreed, count),
    }


def write_settings(settings: Sequence[Setting], path: Path) -> None:
    """Write as CSV, in place of what is there of the same networks."""
    networks = {item.network for item in settings}
    kept = [item for item in read_settings(path) if item.network not in networks]
    write_lines(path, Setting, [*kept, *settings])


def read_settings(path: Path) -> list[Setting]:
    """Read what :func:`write_settings` wrote; nothing if there is no file."""
    if not path.is_file():
        return []
    types = {entry.name: entry.type for entry in fields(Setting)}
    return [
        Setting(**{key: types[key](value) for key, value in line.items()})  # type: ignore[operator]
        for line in read_rows(path)
    ]


def full_labels(
    classifier: SurfaceClassifier, samples: Sequence[Sample], store: Store
) -> list[int]:
    """The label of every sample by all its fragments."""
    return [classify_sample(classifier, sample, store)[0].label for sample in samples]


def sequential_votes(
    classifier: SurfaceClassifier, decision: DecisionConfig, samples: Sequence[Sample], store: Store
) -> list[Vote]:
    """The vote on every sample by as many fragments as ``decision`` asks for."""
    sequential = SequentialClassifier(classifier, decision)
    title = f"alpha {decision.alpha:g}, confidence threshold {decision.confidence_threshold:g}"
    return [classify_sample(sequential, sample, store)[0] for sample in track(samples, title)]


def measure(
    classifier: SurfaceClassifier,
    decision: DecisionConfig,
    samples: Sequence[Sample],
    labels: Sequence[int],
    store: Store,
    knob: str,
    value: float,
) -> Setting:
    """Classify all samples with one threshold.

    Args:
        classifier: Classifier of the full decision.
        decision: The threshold.
        samples: What is classified.
        labels: Labels of the full decision.
        store: Their recordings.
        knob: Name of the threshold, for the table.
        value: Value of the threshold.
    """
    votes = sequential_votes(classifier, decision, samples, store)
    names, count = classifier.card.classes, len(samples)
    return Setting(
        network=classifier.card.kind,
        knob=knob,
        value=value,
        test_samples=count,
        correct=sum(names[v.label] == s.label for v, s in zip(votes, samples, strict=True)),
        agreed=sum(vote.label == label for vote, label in zip(votes, labels, strict=True)),
        relative_macs=sum(vote.relative_macs for vote in votes) / count,
        fragments=sum(len(vote.fragments) for vote in votes) / count,
    )
