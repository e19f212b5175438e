"""Load the systems that are to be perturbed: checkpoints, each with its test samples."""

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import Card
from tex_lightning.config import Config
from tex_lightning.config.model import FUSION, kind_of
from tex_lightning.config.tasks import TRAINING
from tex_lightning.core.devices import pick_device
from tex_lightning.core.run_folder import SUFFIX, run_of
from tex_lightning.data.folds import make_samples
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.learning.provenance import as_trained
from tex_lightning.report.table import model_label, run_settings
from tex_lightning.studies.dataset import open_test_data
from tex_lightning.studies.description import show_opening
from tex_lightning.studies.perturbed import PerturbedSystem, Perturber, SystemFold
from tex_lightning_runtime.files import expanded

TestedCheckpoint = tuple[Path, int | None]  # its test fold is None for the configured one


def load_systems(config: Config, *, choose: bool = False) -> list[PerturbedSystem]:
    """Load every system with the test samples of each of its folds.

    Args:
        config: ``stability`` names the systems, ``data`` what they are tested on.
        choose: Whether recordings are divided as each checkpoint was trained. Folds of a
            cross-validation always are: another division has other folds of these numbers.

    Raises:
        UserError: If a folder or checkpoint cannot be used, knows other classes, or was trained on
            what it would be tested on.
    """
    perturber = Perturber(config.seed)
    systems, places = list[PerturbedSystem](), list[str]()
    paths = [expanded(name) for name in config.stability.systems or []]
    homes = _short_paths(paths)
    for path, home in zip(paths, homes, strict=True):
        for checkpoints in _checkpoints(path).values():
            folds: list[SystemFold] = []
            for file, fold in checkpoints:
                first = not (systems or folds)
                folds.append(_load(config, file, fold, perturber, choose=choose, show=first))
            card = folds[0].classifier.card
            name, label = _names(path, card)
            systems.append(PerturbedSystem(name, card.kind, folds, label))
            places.append(home)
    counts, numbers = Counter(system.name for system in systems), Counter[str]()
    for system, home in zip(systems, places, strict=True):
        numbers[title := system.name] += 1
        if counts[title] > 1:  # those of one name get a number, and readers what it stands for
            system.name = f"{title} ({numbers[title]})"
            system.label += f" ({numbers[title]}: {home})"
    return systems


def _short_paths(paths: Sequence[Path]) -> list[str]:
    """Return paths without the folders that all of them share."""
    whole = [path.absolute() for path in paths]
    shared = os.path.commonpath([path.parent for path in whole]) if whole else ""
    return [path.relative_to(shared).as_posix() for path in whole]


def _checkpoints(path: Path) -> dict[str, list[TestedCheckpoint]]:
    """Return the checkpoints of each kind in a run folder, fold by fold; or the file itself."""
    if path.is_file():
        return {"": [(path, None)]}
    if not path.is_dir():
        raise UserError(f"{path} does not exist; give a run folder or a checkpoint.")
    folds = sorted(
        int(folder.name) for folder in path.glob("folds/[0-9]*") if folder.name.isdecimal()
    )
    homes: list[TestedCheckpoint] = [(path / "folds" / str(fold), fold) for fold in folds]
    checkpoints: dict[str, list[TestedCheckpoint]] = {}
    for home, fold in homes or [(path, None)]:
        for file in sorted(home.glob(f"checkpoints/*{SUFFIX}")):
            checkpoints.setdefault(file.stem, []).append((file, fold))
    if not checkpoints:
        raise UserError(
            f"{path} holds no finished checkpoint (checkpoints/KIND.ckpt or "
            "folds/N/checkpoints/KIND.ckpt); give the folder of a finished run."
        )
    kinds = sorted(checkpoints, key=lambda kind: (kind != FUSION, kind))
    return {kind: checkpoints[kind] for kind in kinds}


def _load(
    config: Config, path: Path, fold: int | None, perturber: Perturber, *, choose: bool, show: bool
) -> SystemFold:
    """Load a checkpoint and its test samples; if ``show``, print what data these are."""
    loaded = load_classifier(path)
    data = config.data if fold is None else config.on_fold(fold).data
    if choose or fold is not None:
        data = as_trained(data, loaded.card)
    dataset, _ = open_test_data(data, loaded, f"Checkpoint {path}")
    if show:
        show_opening(data, dataset, ", ".join(config.stability.systems or []))
    samples = make_samples(dataset.recordings, loaded.card.modalities)
    loaded.to(pick_device(config.trainer.accelerator))
    classifier = accelerate(loaded, config.engine).eval()
    return SystemFold(path, classifier, samples, dataset.store, perturber)


def _names(path: Path, card: Card) -> tuple[str, str]:
    """Return the name of a system, and that for readers: of its model, or of a part of that."""
    settings = run_settings(path if path.is_dir() else run_of(path))
    model = settings.get("model.name") if settings.get("task") in TRAINING else None
    if model and kind_of(settings["model.senses"]) == card.kind:
        return model, model_label(model)
    if baseline := card.baseline.get("name"):
        return baseline, model_label(baseline)
    return card.kind, f"{card.kind} inside {model}" if model else card.kind
