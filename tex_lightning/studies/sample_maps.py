"""Pictures of what the network predicted at every position of the worst test samples."""

import glob
from collections.abc import Sequence
from pathlib import Path

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.data.folds import Sample
from tex_lightning.data.quality import Quality
from tex_lightning.data.store import Store, load_sample
from tex_lightning.evaluation.outcomes import Outcome, worst_first
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.evidence import classify_with_maps
from tex_lightning.inference.prediction import describe
from tex_lightning.report.explanation import Explanation
from tex_lightning.report.figures import save_figure

CANDIDATES = 3  # classes whose votes are shown


def worst_samples(outcomes: Sequence[Outcome], count: int) -> list[int]:
    """Return indices of the most confident wrong samples, or of the least confident if none is."""
    worst = worst_first(outcomes)
    wrong = [index for index in worst if outcomes[index].label != outcomes[index].predicted]
    return wrong[:count] or worst[: min(count, 1)]


def draw_worst(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
    config: Config,
    directory: Path,
) -> None:
    """Draw the worst samples by the full decision, in place of what an earlier run drew.

    A baseline has no such pictures.
    """
    name = classifier.card.kind
    for older in (directory / "figures").glob(f"{glob.escape(name)}_why_*"):
        older.unlink()
    worst = worst_samples(outcomes, config.explained_samples)
    if classifier.card.baseline or not worst:
        return
    fast = accelerate(classifier, config.engine)
    fast.card = fast.card.deciding(config.decision)
    for number, row in enumerate(worst, start=1):
        sample = samples[row]
        files = ", ".join(Path(each.source).name for each in sample.recordings.values())
        explanation = _explain(fast, sample, store)
        figure = explanation.figure(f"{name}: test sample of {sample.label} ({files})")
        save_figure(figure, directory / "figures" / f"{name}_why_{number}")


def _explain(fast: SurfaceClassifier, sample: Sample, store: Store) -> Explanation:
    vote, senses = classify_with_maps(fast, load_sample(sample, store))
    used = fast.card.modalities if fast.fusion is not None else ()
    prediction = describe(vote, fast.card, Quality(), CANDIDATES, 0.0, used)
    return Explanation.of(prediction, fast.card.classes, vote.label, senses)
