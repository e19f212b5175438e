"""Test a checkpoint: its outcomes, its entry of ``results.json`` and its figures.

The figure of a sample has its recordings, and the class at every position of the networks.
"""

import glob
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.core.devices import pick_device
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store, Unusable, load_sample, skipped_entry
from tex_lightning.evaluation.calibration import calibration
from tex_lightning.evaluation.novelty import report_unknown
from tex_lightning.evaluation.outcomes import (
    Outcome,
    by_condition,
    environment,
    run_test,
    summarise,
    vote_counts,
    worst_samples,
    write_outcomes,
)
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.inference.engine import accelerate, count_macs
from tex_lightning.inference.prediction import warn_of_few
from tex_lightning.report.figures import calibration_figure, confusion_figure, save_figure
from tex_lightning.report.style import brief, looks, styled
from tex_lightning.senses.features.spectrogram import movement_start
from tex_lightning.senses.signal import SignalSense
from tex_lightning.text import printable


def results_frame(
    config: Config,
    model: str,
    classes: list[str],
    skipped: Sequence[Unusable],
    networks: dict[str, Any],
    seconds: float,
) -> dict[str, Any]:
    """The entries of ``results.json`` around its networks."""
    return {
        "task": config.task,
        "model": model,
        "data": config.data.name,
        "classes": classes,
        "seed": config.seed,
        "wall_seconds": seconds,
        "skipped": skipped_entry(skipped),
        "environment": environment(pick_device(config.trainer.accelerator)),
        "networks": networks,
    }


def report_network(
    classifier: SurfaceClassifier,
    checkpoint: Path,
    samples: Sequence[Sample],
    store: Store,
    directory: Path,
    config: Config,
    unknown: Sequence[Sample] = (),
) -> tuple[dict[str, Any], list[Outcome]]:
    """Test a network as prediction runs it; write its predictions into the run folder.

    Args:
        classifier: The network, on its device.
        checkpoint: Its file.
        samples: What is tested, at least one.
        store: Their recordings.
        directory: The run folder.
        config: How it runs and decides.
        unknown: Samples of classes that were held out.

    Returns:
        Its entry of ``results.json``, and what became of each sample.
    """
    kind = classifier.card.kind
    warn_of_few(classifier.card.deciding(config.decision))
    decider = make_inference_model(classifier, config.engine, config.decision)
    fold = None if config.data.test_where else config.data.test_fold
    outcomes = run_test(decider, samples, store, fold)
    write_outcomes(outcomes, directory / "predictions" / f"{kind}.csv")
    recordings = load_sample(samples[0], store)
    entry = {
        **pooled_metrics(outcomes),
        **by_condition(samples, outcomes),
        "parameters": classifier.count_parameters(),
        # None for a baseline whose arithmetic is outside PyTorch and not counted
        "macs_per_sample": count_macs(lambda: classifier.logits(**recordings)) or None,
        "fit_seconds": classifier.card.training.get("fit_seconds", 0.0),
        "val_loss": classifier.card.training.get("val_loss"),
        "checkpoint": str(checkpoint.resolve()),
        **report_unknown(decider, unknown, store, directory, outcomes, fold),
    }
    return entry, outcomes


def pooled_metrics(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Entries of ``results.json`` that follow from the outcomes of one fold or of several."""
    entry = {**summarise(outcomes), "calibration": calibration(outcomes)}
    if any(outcome.relative_macs != 1 for outcome in outcomes):  # of sequential decisions
        entry["relative_macs"] = fmean(outcome.relative_macs for outcome in outcomes)
    return entry


def draw_figures(
    outcomes: Sequence[Outcome],
    classes: list[str],
    name: str,
    directory: Path,
) -> None:
    """Save confusions and calibration."""
    counts = vote_counts(outcomes, classes)
    title = f"{name}: votes on {len(outcomes)} test samples"
    figures = {
        "confusion": confusion_figure(counts, classes, title),
        "calibration": calibration_figure(outcomes, name),
    }
    for title, figure in figures.items():
        save_figure(figure, directory / "figures" / f"{name}_{title}")


def draw_worst(
    classifier: SurfaceClassifier,
    samples: Sequence[Sample],
    outcomes: Sequence[Outcome],
    store: Store,
    config: Config,
    directory: Path,
) -> None:
    """Draw the worst samples, in place of those of an earlier run; a baseline has no positions."""
    name = classifier.card.kind
    for older in (directory / "figures").glob(f"{glob.escape(name)}_wrong_*"):
        older.unlink()
    worst = worst_samples(outcomes, config.explained_samples)
    if classifier.card.baseline or not worst:
        return
    fast = accelerate(classifier, config.engine)
    for number, row in enumerate(worst, start=1):
        outcome = outcomes[row]
        files = ", ".join(Path(file).name for file in outcome.files.values())
        title = f"{outcome.label} classified as {outcome.predicted} ({files})"
        figure = sample_figure(fast, load_sample(samples[row], store), title)
        save_figure(figure, directory / "figures" / f"{name}_wrong_{number}")


SIZE = (9.0, 3.0)  # inches of a sense
FRAME = 512  # samples of a column of the spectrogram
Array = npt.NDArray[np.floating]


@styled
def sample_figure(
    classifier: SurfaceClassifier, recordings: Mapping[str, Tensor], title: str
) -> Figure:
    """Draw the recordings of a sample, and the class with the largest score at every position.

    Positions are drawn as equal parts of a photo, or of the movement in a signal.

    Args:
        classifier: A network, in evaluation mode.
        recordings: Decoded recordings by modality.
        title: A line above the figure.
    """
    labels = {
        name: _position_labels(classifier, name, recordings[sense.modality])
        for name, sense in classifier.senses.items()
    }
    counts = Counter(name for grid in labels.values() for name in grid.ravel().tolist())
    colours = {name: look.colour for name, look in looks(dict(counts.most_common())).items()}
    figure = Figure(figsize=(SIZE[0], SIZE[1] * len(labels)), layout="constrained")
    figure.suptitle(printable(title))
    parts = figure.subfigures(len(labels), 1, squeeze=False)[:, 0]
    for part, (name, grid) in zip(parts, labels.items(), strict=True):
        sense = classifier.senses[name]
        recording = recordings[sense.modality].cpu()
        painted = np.array([[to_rgb(colours[label]) for label in row] for row in grid])
        if isinstance(sense, SignalSense):
            rate, skips = sense.decoder.sampling_rate, getattr(sense.features, "skip_impact", False)
            start = movement_start(recording, rate) if skips else 0
            _draw_signal(part, recording.numpy(), painted, rate, start / rate)
        else:
            _draw_photo(part, recording.numpy(), painted)
    patches = [Patch(color=colour, label=brief(name)) for name, colour in colours.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=3)
    return figure


@torch.inference_mode()
def _position_labels(
    classifier: SurfaceClassifier, name: str, recording: Tensor
) -> npt.NDArray[np.str_]:
    """Return the class name (rows, columns) at every position of one sense."""
    sense = classifier.senses[name]
    grid = sense.dense_grid(sense.dense_input(recording), classifier.level(name))
    indices = classifier.project(name, grid.flatten(1)).argmax(dim=0).reshape(grid.shape[1:])
    names: npt.NDArray[np.str_] = np.array(classifier.card.classes)[indices.cpu().numpy()]
    return names


def _draw_photo(figure: SubFigure, photo: Array, painted: Array) -> None:
    """Draw a photo (height, width, 3), and beside it colours (rows, columns, 3) over it."""
    height, width = photo.shape[:2]
    plain, covered = figure.subplots(1, 2)
    plain.imshow(photo)
    covered.imshow(photo.mean(axis=2), cmap="gray")
    covered.imshow(painted, extent=(0, width, height, 0), alpha=0.5)


def _draw_signal(
    figure: SubFigure, signal: Array, painted: Array, rate: float, start: float
) -> None:
    """Draw the spectrogram of the strongest axis, and colours (1, columns, 3) from ``start`` on."""
    spectrogram, strip = figure.subplots(2, 1, sharex=True, height_ratios=(5, 1))
    strongest = signal[signal.std(axis=1).argmax()]
    length = min(FRAME, len(strongest))
    spectrogram.specgram(
        strongest, NFFT=length, Fs=rate, noverlap=length // 2, detrend="mean", cmap="magma"
    )
    spectrogram.set(ylabel="Hz")
    seconds = len(strongest) / rate
    strip.imshow(painted, extent=(start, seconds, 0, 1), aspect="auto")
    strip.set(xlim=(0, seconds), yticks=[], xlabel="s", ylabel="class")
