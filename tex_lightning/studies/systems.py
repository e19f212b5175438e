"""The systems that ``task=stability`` tests, from run folders and checkpoints."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import SUFFIX
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, StabilityConfig
from tex_lightning.config.keys import choice
from tex_lightning.config.model import FUSION, kind_of
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record
from tex_lightning.core.run_folder import SETTINGS
from tex_lightning.data.decode import Decoder
from tex_lightning.data.folds import make_samples
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.perturbations.table import (
    BOTH,
    SEVERITIES,
    Perturbation,
    perturbations,
    read_severities,
)
from tex_lightning.studies.dataset import open_test_data, show_opening
from tex_lightning.studies.perturbed import PerturbedDataset, PerturbedSystem, SystemFold

TestedCheckpoint = tuple[Path, int | None]  # its test fold is None for the configured one
Datasets = dict[tuple[str, Decoder], PerturbedDataset]  # by modality and how it is decoded


def load_systems(config: Config) -> list[PerturbedSystem]:
    """Load every system with the test samples of each of its folds.

    Args:
        config: ``stability`` names the systems, ``data`` what they are tested on.

    Raises:
        UserError: If a folder or checkpoint cannot be used, knows other classes, or was trained on
            what it would be tested on.
    """
    datasets: Datasets = {}
    systems: list[PerturbedSystem] = []
    for name in config.stability.systems or []:
        path = Path(name).expanduser()
        for kind, checkpoints in _checkpoints(path).items():
            folds = [_load(config, *checkpoint, datasets) for checkpoint in checkpoints]
            classifier = folds[0].classifier
            title = _title(path, kind, classifier)
            systems.append(PerturbedSystem(title, classifier.card.kind, folds))
    counts, numbers = Counter(system.name for system in systems), Counter[str]()
    for system in systems:  # those of one name get a number
        numbers[title := system.name] += 1
        system.name = f"{title} ({numbers[title]})" if counts[title] > 1 else title
    return systems


def choose_perturbations(
    systems: Sequence[PerturbedSystem], settings: StabilityConfig
) -> list[Perturbation]:
    """Choose the perturbations asked for that some system meets; try those of the user.

    Raises:
        UserError: If a name is unknown, no system meets any, or a table cannot be used.
    """
    known = dict(perturbations())
    for path in settings.severities:
        known |= read_severities(path)
    for name in settings.only or ():
        if complaint := next(choice("stability.only", name, tuple(known)), None):
            raise UserError(f"{complaint}.")
    asked = [known[name] for name in settings.only or known]
    chosen = [each for each in asked if any(system.meets(each) for system in systems)]
    if not chosen:
        names = ", ".join(each.name for each in asked)
        raise UserError(f"No system meets {names}; choose other stability.only or systems.")
    for perturbation in chosen:
        if perturbation.is_users and perturbation.modality != BOTH:
            fold = next(system for system in systems if system.meets(perturbation)).folds[0]
            row = fold.samples[0].recordings[perturbation.modality]
            for severity in (SEVERITIES[0], SEVERITIES[-1]):
                fold.datasets[perturbation.modality].perturbed(row, perturbation, severity)
    return chosen


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


def _load(config: Config, path: Path, fold: int | None, datasets: Datasets) -> SystemFold:
    """One checkpoint and its test samples, whose recordings join those decoded alike."""
    loaded = load_classifier(path)
    data = config.data if fold is None else config.on_fold(fold).data
    dataset = open_test_data(data, loaded, f"Checkpoint {path}")
    if not datasets:  # the first one's data are shown
        show_opening(data, dataset, ", ".join(config.stability.systems or []), trains=False)
    samples = make_samples(dataset.recordings, loaded.card.modalities)
    perturbed = {}
    for modality, decoder in dataset.store.decoders.items():
        fresh = PerturbedDataset(getattr(decoder, "sampling_rate", 0.0), config.seed)
        perturbed[modality] = datasets.setdefault((modality, decoder), fresh)
        perturbed[modality].add((sample.recordings[modality] for sample in samples), dataset.store)
    loaded.to(pick_device(config.trainer.accelerator))
    classifier = accelerate(loaded, config.engine).eval()
    return SystemFold(path, classifier, samples, perturbed)


def _title(path: Path, kind: str, classifier: SurfaceClassifier) -> str:
    """The model of a run; the kind of a network that only accompanies it, or of a bare file."""
    note = path / SETTINGS
    if path.is_dir() and note.is_file():
        settings = read_record(note)
        senses = settings.get("model.senses")
        if senses and kind_of(senses) == kind:
            return str(settings["model.name"])
    return str(classifier.card.baseline.get("name", classifier.card.kind))
