"""Pictures of what the network said of the test samples that it took for something else."""

import glob
import shutil
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from matplotlib.figure import Figure

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
from tex_lightning.report.page_media import MOST_SAMPLES, map_folder, write_map

CANDIDATES = 3  # classes whose votes are shown

# a network, and what it tested by row of the predictions
Tested = tuple[SurfaceClassifier, Mapping[int, Sample]]


def telling(outcomes: Sequence[Outcome], count: int) -> list[int]:
    """Indices of the wrong samples that were the surest, or if none is wrong of the least sure."""
    worst = worst_first(outcomes)
    wrong = [index for index in worst if outcomes[index].label != outcomes[index].predicted]
    return wrong[:count] or worst[: min(count, 1)]


def drawn_rows(outcomes: Sequence[Outcome], count: int) -> list[int]:
    """Indices of the samples that label maps are drawn of, the worst first.

    They are those that ``report.html`` shows, and the ``count`` telling ones are the first of them.
    """
    return worst_first(outcomes)[: max(count, MOST_SAMPLES)] if count else []


def draw_telling(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
    config: Config,
    directory: Path,
) -> dict[str, Figure]:
    """As :func:`draw_explanations`, where one network tested all samples."""
    tested = {row: samples[row] for row in drawn_rows(outcomes, config.explained_samples)}
    name = classifier.card.kind
    return draw_explanations([(classifier, tested)], outcomes, store, config, name, directory)


def draw_explanations(
    tested: Iterable[Tested],
    outcomes: Sequence[Outcome],
    store: Store,
    config: Config,
    name: str,
    directory: Path,
) -> dict[str, Figure]:
    """Draw label maps of the samples, and pictures of some telling ones of them.

    Both are of one pass by the full decision. What an earlier run drew in their place goes.

    Returns:
        The pictures, for other uses; nothing is drawn of a baseline.
    """
    shutil.rmtree(map_folder(directory, name), ignore_errors=True)
    for older in (directory / "figures").glob(f"{glob.escape(name)}_why_*"):
        older.unlink()
    figures, chosen = {}, telling(outcomes, config.explained_samples)
    for classifier, samples in tested:
        if classifier.card.baseline:
            break
        fast = accelerate(classifier, config.engine)
        fast.card = fast.card.deciding(config.decision)
        for row, sample in samples.items():
            found = explain_sample(fast, sample, store)
            _write_maps(fast, found, outcomes[row], map_folder(directory, name) / str(row))
            if row in chosen:
                title = f"why_{chosen.index(row) + 1}"
                files = ", ".join(Path(each.source).name for each in sample.recordings.values())
                figure = found.figure(f"{name}: test sample of {sample.label} ({files})")
                path = directory / "figures" / f"{name}_{title}"
                save_figure(figure, path)
                figures[title] = figure
    return figures


def explain_sample(fast: SurfaceClassifier, sample: Sample, store: Store) -> Explanation:
    """Of one test sample, by the full decision.

    Args:
        fast: A network as it tests, with the card that decides.
        sample: With all its recordings.
        store: Where they are decoded.
    """
    vote, senses = classify_with_maps(fast, load_sample(sample, store))
    said = fast.card.modalities if fast.fusion is not None else ()
    prediction = describe(vote, fast.card, Quality(), CANDIDATES, 0.0, said)
    return Explanation.of(prediction, fast.card.classes, vote.label, senses)


def _write_maps(
    classifier: SurfaceClassifier, found: Explanation, outcome: Outcome, folder: Path
) -> None:
    for name, evidence in found.senses.items():
        path = folder / classifier.senses[name].modality / f"{name}.png"
        write_map(path, evidence, found.classes, outcome.label, outcome.predicted)
