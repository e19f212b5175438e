"""Pictures of what the network said of the test samples that it took for something else."""

import glob
import shutil
from collections.abc import Sequence
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


def telling(outcomes: Sequence[Outcome], count: int) -> list[int]:
    """Return indices of the wrong samples that were the surest, or else of the least sure one."""
    worst = worst_first(outcomes)
    wrong = [index for index in worst if outcomes[index].label != outcomes[index].predicted]
    return wrong[:count] or worst[: min(count, 1)]


def draw_telling(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
    config: Config,
    directory: Path,
) -> dict[str, Figure]:
    """Draw label maps of the worst samples, as ``report.html`` shows them, and telling figures.

    Both are of one pass by the full decision. What an earlier run drew in their place goes.

    Args:
        classifier: That tested the samples; nothing is drawn of a baseline.
        samples: What was tested.
        outcomes: What became of each.
        store: Where they are decoded.
        config: ``explained_samples`` is the number of figures; 0 draws nothing.
        directory: The run folder.

    Returns:
        The figures, for other uses.
    """
    name, count = classifier.card.kind, config.explained_samples
    shutil.rmtree(map_folder(directory, name), ignore_errors=True)
    for older in (directory / "figures").glob(f"{glob.escape(name)}_why_*"):
        older.unlink()
    figures: dict[str, Figure] = {}
    if classifier.card.baseline or not count:
        return figures
    fast, chosen = accelerate(classifier, config.engine), telling(outcomes, count)
    fast.card = fast.card.deciding(config.decision)
    modalities = fast.card.modalities if fast.fusion is not None else ()
    for row in worst_first(outcomes)[: max(count, MOST_SAMPLES)]:
        sample, folder = samples[row], map_folder(directory, name) / str(row)
        vote, senses = classify_with_maps(fast, load_sample(sample, store))
        prediction = describe(vote, fast.card, Quality(), CANDIDATES, 0.0, modalities)
        explanation = Explanation.of(prediction, fast.card.classes, vote.label, senses)
        _write_maps(fast, explanation, outcomes[row], folder)
        if row in chosen:
            title = f"why_{chosen.index(row) + 1}"
            files = ", ".join(Path(each.source).name for each in sample.recordings.values())
            figures[title] = explanation.figure(f"{name}: test sample of {sample.label} ({files})")
            save_figure(figures[title], directory / "figures" / f"{name}_{title}")
    return figures


def _write_maps(
    classifier: SurfaceClassifier, explanation: Explanation, outcome: Outcome, folder: Path
) -> None:
    for name, evidence in explanation.senses.items():
        path = folder / classifier.senses[name].modality / f"{name}.png"
        write_map(path, evidence, explanation.classes, outcome.label, outcome.predicted)
