"""Test whether materials never seen get less confidence than those that were trained on."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store
from tex_lightning.evaluation.calibration import unknown_auroc
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes
from tex_lightning.evaluation.samples import run_test


def report_unknown(
    classifier: SurfaceClassifier, samples: Sequence[Sample], store: Store, directory: Path
) -> dict[str, Any]:
    """Classify samples of held-out classes as the test classified the others, and compare.

    Returns:
        ``unknown`` of ``results.json``; nothing where there are no such samples.
    """
    if not samples:
        return {}
    name = classifier.card.kind
    unknown = run_test(classifier, samples, store)
    write_outcomes(unknown, _file(directory, name))
    known = read_outcomes(directory / "predictions" / f"{name}.csv")
    return {"unknown": unknown_auroc(known, unknown)}


def pool_unknown(
    folds: Sequence[Path], name: str, known: Sequence[Outcome], directory: Path
) -> dict[str, Any]:
    """The same of several folds, from their files."""
    files = [_file(fold, name) for fold in folds]
    unknown = [outcome for file in files if file.is_file() for outcome in read_outcomes(file)]
    if not unknown:
        return {}
    write_outcomes(unknown, _file(directory, name))
    return {"unknown": unknown_auroc(known, unknown)}


def _file(directory: Path, name: str) -> Path:
    return directory / "predictions" / f"{name}_unknown.csv"
