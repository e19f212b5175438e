"""The systems that ``task=stability`` tests, from run folders and checkpoints."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import SUFFIX
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, StabilityConfig
from tex_lightning.config.model import FUSION, kind_of
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record
from tex_lightning.core.run_folder import SETTINGS
from tex_lightning.data.decode import Decoder
from tex_lightning.data.folds import Sample, make_samples
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.studies.dataset import open_test_data, show_opening
from tex_lightning.studies.perturbed import PerturbedDataset, PerturbedSystem, SystemFold

Found = tuple[Path, int | None]  # a checkpoint and its test fold, None for the configured one
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
    for given in config.stability.systems or []:
        path = Path(given).expanduser()
        for kind, found in _checkpoints(path, config.stability).items():
            folds = [_load(config, *each, datasets) for each in found]
            classifier = folds[0].classifier
            name = _name(path, kind, classifier)
            systems.append(PerturbedSystem(name, classifier.card.kind, folds))
    counts, numbers = Counter(system.name for system in systems), Counter[str]()
    for system in systems:  # those of one name get a number
        numbers[name := system.name] += 1
        system.name = f"{name} ({numbers[name]})" if counts[name] > 1 else name
    return systems


def _checkpoints(path: Path, wanted: StabilityConfig) -> dict[str, list[Found]]:
    """Checkpoints of each kind in a run folder, fold by fold; or the file itself."""
    if path.is_file():
        return {"": [(path, None)]}
    if not path.is_dir():
        raise UserError(f"{path} does not exist; give a run folder or a checkpoint.")
    folds = {int(each.name): each for each in path.glob("folds/[0-9]*") if each.name.isdecimal()}
    if wanted.folds is not None:
        folds = {fold: each for fold, each in folds.items() if fold in wanted.folds}
    homes: list[tuple[Path, int | None]] = [(folds[fold], fold) for fold in sorted(folds)]
    found: dict[str, list[Found]] = {}
    for home, fold in homes or [(path, None)]:
        for file in sorted(home.glob(f"checkpoints/*{SUFFIX}")):
            found.setdefault(file.stem, []).append((file, fold))
    if not found:
        raise UserError(
            f"{path} holds no finished checkpoint (checkpoints/KIND.ckpt or "
            "folds/N/checkpoints/KIND.ckpt); give the folder of a finished run."
        )
    kinds = sorted(found, key=lambda kind: (kind != FUSION, kind))
    return {kind: found[kind] for kind in (kinds if wanted.parts else kinds[:1])}


def _load(config: Config, path: Path, fold: int | None, datasets: Datasets) -> SystemFold:
    """One checkpoint and its test samples, whose recordings join those decoded alike."""
    loaded = load_classifier(path)
    if fold is not None:
        config = replace(config, data=replace(config.data, test_fold=fold))
    dataset = open_test_data(config, loaded, f"Checkpoint {path}")
    if not datasets:  # the first one's data are shown
        show_opening(config, dataset, ", ".join(config.stability.systems or []), trains=False)
    samples = _limited(make_samples(dataset.recordings, loaded.card.modalities), config.stability)
    own = {}
    for modality, decoder in dataset.store.decoders.items():
        fresh = PerturbedDataset(getattr(decoder, "sampling_rate", 0.0), config.seed)
        own[modality] = datasets.setdefault((modality, decoder), fresh)
        own[modality].add((each.recordings[modality] for each in samples), dataset.store)
    loaded.to(pick_device(config.trainer.accelerator))
    classifier = accelerate(loaded, config.engine).eval()
    return SystemFold(path, classifier, samples, own, dataset.skipped)


def _limited(samples: list[Sample], wanted: StabilityConfig) -> list[Sample]:
    """The first samples of each class."""
    counts: Counter[str] = Counter()
    kept = []
    for sample in samples:
        counts[sample.label] += 1
        if wanted.limit is None or counts[sample.label] <= wanted.limit:
            kept.append(sample)
    return kept


def _name(path: Path, kind: str, classifier: SurfaceClassifier) -> str:
    """The model of a run; the kind of a network that only accompanies it, or of a bare file."""
    note = path / SETTINGS
    if path.is_dir() and note.is_file():
        settings = read_record(note)
        senses = settings.get("model.senses")
        if senses and kind_of(senses) == kind:
            return str(settings["model.name"])
    return str(classifier.card.baseline.get("name", classifier.card.kind))
