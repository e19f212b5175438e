"""Test whether materials never seen get less confidence, and more novelty, than trained ones."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.classifier.unknown import novelty_threshold
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store
from tex_lightning.evaluation.calibration import unknown_auroc
from tex_lightning.evaluation.outcomes import (
    Outcome,
    read_outcomes,
    wilson_interval,
    write_outcomes,
)
from tex_lightning.evaluation.samples import run_test


@dataclass(frozen=True)
class Tested:
    """The test samples of one checkpoint.

    Attributes:
        known: Samples of its classes.
        unknown: Samples of classes that were held out.
        threshold: Novelty above which a sample is called unknown; None where nothing sets it.
    """

    known: Sequence[Outcome]
    unknown: Sequence[Outcome]
    threshold: float | None


def report_unknown(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    store: Store,
    directory: Path,
    known: Sequence[Outcome],
    fold: int | None = None,
) -> dict[str, Any]:
    """Classify samples of held-out classes as the test classified the others, and compare.

    Args:
        classifier: As it decides.
        samples: Samples of the held-out classes.
        store: Their recordings.
        directory: The run folder.
        known: What became of the others.
        fold: Fold that was tested.

    Returns:
        ``unknown`` of ``results.json``; nothing where there are no such samples and
        ``decision.unknown`` is not set.
    """
    card = classifier.card
    unknown = run_test(classifier, samples, store, fold) if samples else []
    if unknown:
        write_outcomes(unknown, _file(directory, card.kind))
    return _entry([Tested(known, unknown, card.unknown_above)], card.unknown)


def pool_unknown(
    folds: Mapping[Path, Mapping[str, Any]],
    known: Sequence[Sequence[Outcome]],
    name: str,
    directory: Path,
    rate: float | None,
) -> dict[str, Any]:
    """Pool :func:`report_unknown` of several folds, whose files have the held-out samples.

    A fold whose own checkpoint has nothing to set a threshold by has that of what the other folds
    were tested on: their networks had not seen it either.

    Args:
        folds: By folder the network's entry of ``results.json``.
        known: What became of the others in each fold.
        name: Name of the network.
        directory: The run folder.
        rate: ``decision.unknown``.
    """
    files = [_file(fold, name) for fold in folds]
    unknown = [read_outcomes(file) if file.is_file() else [] for file in files]
    if found := [outcome for part in unknown for outcome in part]:
        write_outcomes(found, _file(directory, name))
    tested = []
    for place, entry in enumerate(folds.values()):
        threshold = entry.get("unknown", {}).get("threshold")
        others = [each.novelty for part in [*known[:place], *known[place + 1 :]] for each in part]
        if threshold is None and rate and others and not any(map(math.isnan, others)):
            threshold = novelty_threshold(others, rate)
        tested.append(Tested(known[place], unknown[place], threshold))
    return _entry(tested, rate)


def _entry(tested: Sequence[Tested], rate: float | None) -> dict[str, Any]:
    unknown = [outcome for each in tested for outcome in each.unknown]
    entry: dict[str, Any] = {}
    if unknown:
        entry = unknown_auroc([outcome for each in tested for outcome in each.known], unknown)
    if rate:
        entry |= {"rate": rate, **_rejection(tested)}
    return {"unknown": entry} if entry else {}


def _rejection(tested: Sequence[Tested]) -> dict[str, Any]:
    """What the thresholds do.

    Returns:
        ``threshold``, of several their mean; ``false_rejections``, known samples called unknown;
        ``accepted_unknown``, unknown samples given a class; ``accepted_wrong``, samples of both
        kinds given a class that is not theirs, of all that are given one. Only the first, None,
        where nothing set a threshold.
    """
    thresholds = [each.threshold for each in tested if each.threshold is not None]
    if len(thresholds) < len(tested):
        return {"threshold": None}
    known = [(o, o.novelty > limit) for each, limit in zip(tested, thresholds, strict=True)
             for o in each.known]  # fmt: skip
    unknown = [(o, o.novelty > limit) for each, limit in zip(tested, thresholds, strict=True)
               for o in each.unknown]  # fmt: skip
    accepted = [outcome for outcome, rejected in known + unknown if not rejected]
    wrong = sum(outcome.label != outcome.predicted for outcome in accepted)
    return {
        "threshold": sum(thresholds) / len(thresholds),
        "false_rejections": _share(sum(rejected for _, rejected in known), len(known)),
        "accepted_unknown": _share(sum(not rejected for _, rejected in unknown), len(unknown)),
        "accepted_wrong": _share(wrong, len(accepted)),
    }


def _share(count: int, of: int) -> dict[str, Any] | None:
    """A count, its share and Wilson's 95 % interval; None of nothing."""
    if not of:
        return None
    return {"count": count, "of": of, "share": count / of, "ci95": wilson_interval(count, of)}


def _file(directory: Path, name: str) -> Path:
    return directory / "predictions" / f"{name}_unknown.csv"
