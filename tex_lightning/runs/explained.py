"""Pictures of what the network said of the test samples that it took for something else."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from matplotlib.figure import Figure

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config.recipe import Running
from tex_lightning.data.folds import Sample
from tex_lightning.data.loading import load_sample
from tex_lightning.data.quality import Quality
from tex_lightning.data.store import Store
from tex_lightning.evaluation.outcomes import Outcome, worst_first
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.gathering import gather
from tex_lightning.prediction import describe
from tex_lightning.report.explanation import Explanation
from tex_lightning.report.figures import save_figure

CANDIDATES = 3  # classes whose votes are shown

Drawn = tuple[SurfaceClassifier, Sample]  # what is drawn, and the network that tested it


def telling(outcomes: Sequence[Outcome], count: int) -> list[int]:
    """Indices of the wrong samples that were the surest, or if none is wrong of the least sure."""
    worst = worst_first(outcomes)
    wrong = [index for index in worst if outcomes[index].label != outcomes[index].predicted]
    return wrong[:count] or worst[: min(count, 1)]


def draw_telling(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
    running: Running,
    count: int,
    directory: Path,
    formats: Sequence[str],
) -> dict[str, Figure]:
    """Draw up to ``count`` telling test samples of one network; none of a baseline."""
    if classifier.card.baseline:
        return {}
    drawn = ((classifier, samples[index]) for index in telling(outcomes, count))
    return draw_explanations(drawn, store, running, classifier.card.kind, directory, formats)


def draw_explanations(
    samples: Iterable[Drawn],
    store: Store,
    running: Running,
    name: str,
    directory: Path,
    formats: Sequence[str],
) -> dict[str, Figure]:
    """Save a picture of each sample into the run folder; return them for other uses."""
    figures = {}
    for number, (classifier, sample) in enumerate(samples, start=1):
        files = ", ".join(Path(row.source).name for row in sample.recordings.values())
        figure = explain_sample(classifier, sample, store, running).figure(
            f"{name}: test sample of {sample.label} ({files})"
        )
        save_figure(figure, directory / "figures" / f"{name}_why_{number}", formats)
        figures[f"why_{number}"] = figure
    return figures


def explain_sample(
    classifier: SurfaceClassifier, sample: Sample, store: Store, running: Running
) -> Explanation:
    """Of one test sample, by the full decision.

    Args:
        classifier: A network, as loaded.
        sample: With all its recordings.
        store: Where they are decoded.
        running: How it runs and decides.
    """
    fast = accelerate(classifier, running.engine)
    fast.card = fast.card.deciding(running.decision)
    vote, senses = gather(fast, load_sample(sample, store))
    said = fast.card.modalities if fast.fusion is not None else ()
    prediction = describe(vote, fast.card, Quality(), CANDIDATES, 0.0, said)
    return Explanation.of(prediction, fast.card.classes, vote.label, senses)
