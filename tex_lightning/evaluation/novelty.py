"""Measure how well unknown materials are told from known ones."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tex_lightning.classifier.card import novelty_threshold
from tex_lightning.classifier.vote import Decider
from tex_lightning.core.run_folder import predictions_of
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store
from tex_lightning.evaluation.calibration import auroc, confidences
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, run_test, write_outcomes

# Known and unknown samples of one network, and the novelty above which it says unknown.
Tested = tuple[Sequence[Outcome], Sequence[Outcome], float | None]


def report_unknown(
    classifier: Decider,
    samples: Sequence[Sample],
    store: Store,
    directory: Path,
    known: Sequence[Outcome],
    fold: int | None = None,
) -> dict[str, Any]:
    """Classify samples of held-out classes as the test classified the others, and compare.

    Returns:
        ``unknown`` of ``results.json``; nothing where there are no such samples and
        ``decision.unknown`` is not set.
    """
    card = classifier.card
    unknown = run_test(classifier, samples, store, fold) if samples else []
    if unknown:
        write_outcomes(unknown, predictions_of(directory, f"{card.kind}_unknown"))
    return unknown_entry([(known, unknown, card.unknown_above)], card.unknown)


def pool_unknown(
    folds: Mapping[Path, Mapping[str, Any]],
    known: Sequence[Sequence[Outcome]],
    name: str,
    directory: Path,
    rate: float | None,
) -> dict[str, Any]:
    """Pool :func:`report_unknown` of several folds, whose files have the held-out samples.

    A fold whose network has no threshold, for want of a validation fold, gets that of the known
    samples of the other folds, each by its own network (cross-conformal prediction).
    """
    files = [predictions_of(fold, f"{name}_unknown") for fold in folds]
    unknown = [read_outcomes(file) if file.is_file() else [] for file in files]
    if pooled := [outcome for part in unknown for outcome in part]:
        write_outcomes(pooled, predictions_of(directory, f"{name}_unknown"))
    limits = [entry.get("unknown", {}).get("threshold") for entry in folds.values()]
    for place, limit in enumerate(limits if rate else ()):
        others = [x.novelty for part in (*known[:place], *known[place + 1 :]) for x in part]
        if limit is None and rate and others and not any(map(math.isnan, others)):
            limits[place] = novelty_threshold(others, rate)
    return unknown_entry(list(zip(known, unknown, limits, strict=True)), rate)


def unknown_entry(tested: Sequence[Tested], rate: float | None) -> dict[str, Any]:
    """Return the entry of ``results.json`` for samples of held-out classes.

    Returns:
        Under ``unknown``: ``classes`` never seen and their ``samples``; ``auroc``, the chance that
        a known sample gets more confidence than an unknown one, and ``novelty_auroc``, that it
        gets less novelty. With a ``rate`` the mean ``threshold`` of novelty, ``false_rejections``
        (known samples called unknown) and ``accepted_unknown`` (unknown ones given a class).
    """
    known = [outcome for part, _, _ in tested for outcome in part]
    unknown = [outcome for _, part, _ in tested for outcome in part]
    entry: dict[str, Any] = {}
    if unknown:
        novelties = [[outcome.novelty for outcome in part] for part in (known, unknown)]
        measured = not any(math.isnan(value) for part in novelties for value in part)
        entry = {
            "classes": sorted({outcome.label for outcome in unknown}),
            "samples": len(unknown),
            "auroc": auroc(confidences(unknown).tolist(), confidences(known).tolist()),
            "novelty_auroc": auroc(*novelties) if measured else None,
        }
    if rate:
        entry |= {"rate": rate, **_rejection(tested)}
    return {"unknown": entry} if entry else {}


def _rejection(tested: Sequence[Tested]) -> dict[str, Any]:
    """Return threshold and rejection counts; only ``threshold``, None, where a network has none."""
    limits = [limit for _, _, limit in tested if limit is not None]
    if len(limits) < len(tested):
        return {"threshold": None}
    pairs = list(zip(tested, limits, strict=True))
    known = [outcome.novelty > limit for (part, _, _), limit in pairs for outcome in part]
    unknown = [outcome.novelty > limit for (_, part, _), limit in pairs for outcome in part]
    return {
        "threshold": sum(limits) / len(limits),
        "false_rejections": _share(sum(known), len(known)),
        "accepted_unknown": _share(len(unknown) - sum(unknown), len(unknown)),
    }


def _share(count: int, of: int) -> dict[str, Any] | None:
    return {"count": count, "of": of, "share": count / of} if of else None
