"""The systems that ``task=stability`` tests, from run folders and checkpoints."""

from collections import Counter
from dataclasses import replace
from pathlib import Path

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import SUFFIX
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, DataConfig, StabilityConfig
from tex_lightning.config.model import FUSION, kind_of
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record
from tex_lightning.core.run_folder import SETTINGS
from tex_lightning.data.folds import Sample, make_samples, tested_part
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, Unusable, cache_root
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.studies.console_summary import Opening
from tex_lightning.studies.dataset import find_unusable
from tex_lightning.studies.evaluate_checkpoint import open_store, recordings_to_test
from tex_lightning.studies.perturbed import Evaluator, Member, PerturbedDataset, System

Found = tuple[Path, int | None]  # a checkpoint and its test fold, None for the configured one


def load_systems(config: Config) -> list[System]:
    """Load every system with the test samples of each of its folds.

    Args:
        config: ``stability`` names the systems, ``data`` what they are tested on.

    Raises:
        UserError: If a folder or checkpoint cannot be used, knows other classes, or was trained on
            what it would be tested on.
    """
    wanted, data = config.stability, config.data
    datasets: list[PerturbedDataset] = []
    systems: list[System] = []
    for given in wanted.systems or []:
        path = Path(given).expanduser()
        for kind, found in _checkpoints(path, wanted).items():
            members = []
            for checkpoint, fold in found:
                tested = data if fold is None else replace(data, test_fold=fold)
                loaded = load_classifier(checkpoint)
                dataset = _dataset(data, config.seed, loaded, datasets)
                loaded.to(pick_device(config.trainer.accelerator))
                engine = accelerate(loaded, config.engine)
                members.append(_member(checkpoint, engine.eval(), tested, dataset, wanted.limit))
            classifier = members[0].evaluator.classifier
            name = _name(path, kind, classifier)
            systems.append(System(name, classifier.card.kind, members))
    opening = Opening(data, ", ".join(wanted.systems or []))
    for each in datasets:
        notes = read_recordings(data, list(each.store.decoders)).notes
        rows = Recordings(tuple(each.rows.values()), notes)
        opening.announce(rows, each.store, skipped_files(systems))
    return _named_apart(systems)


def skipped_files(systems: list[System]) -> list[Unusable]:
    """Files that some system is not tested on, each once."""
    found = [each for system in systems for member in system.members for each in member.skipped]
    return list(dict.fromkeys(found))


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


def _member(
    path: Path,
    classifier: SurfaceClassifier,
    data: DataConfig,
    dataset: PerturbedDataset,
    limit: int | None,
) -> Member:
    rows = recordings_to_test(data, classifier, f"Checkpoint {path}")
    senses = classifier.senses.values()
    skipped = find_unusable(rows, dataset.store, senses, skip_bad=data.skip_bad)
    rows = rows.without(each.recording for each in skipped)
    samples = _limited(make_samples(rows, classifier.card.modalities), limit)
    if not samples:
        raise UserError(
            f"There is nothing to test {path} on in {tested_part(data)}; choose another."
        )
    dataset.add(row for each in samples for row in each.recordings.values())
    return Member(path, Evaluator(classifier), samples, dataset, skipped)


def _dataset(
    data: DataConfig, seed: int, classifier: SurfaceClassifier, datasets: list[PerturbedDataset]
) -> PerturbedDataset:
    """The one of those met before that decodes alike, or another."""
    store = open_store(data, classifier)
    for each in datasets:
        decoders = {**store.decoders, **each.store.decoders}
        if decoders == {**decoders, **store.decoders}:
            if decoders != each.store.decoders:
                known, each.store = each.store.entries, Store(cache_root(data.cache_dir), decoders)
                each.store.entries |= known
            return each
    datasets.append(PerturbedDataset(store, seed))
    return datasets[-1]


def _limited(samples: list[Sample], limit: int | None) -> list[Sample]:
    """The first samples of each class."""
    if limit is None:
        return samples
    seen: Counter[str] = Counter()
    return [each for each in samples if _counted(seen, each.label) <= limit]


def _counted(seen: Counter[str], label: str) -> int:
    seen[label] += 1
    return seen[label]


def _name(path: Path, kind: str, classifier: SurfaceClassifier) -> str:
    """The model of a run; the kind of a network that only accompanies it, or of a bare file."""
    note = path / SETTINGS
    if path.is_dir() and note.is_file():
        settings = read_record(note)
        senses = settings.get("model.senses")
        if senses and kind_of(senses) == kind:
            return str(settings["model.name"])
    return str(classifier.card.baseline.get("name", classifier.card.kind))


def _named_apart(systems: list[System]) -> list[System]:
    """Systems of one name get the folder of their run, and at last a number."""
    for suffix in (_folder_name, _number):
        for name, count in Counter(system.name for system in systems).items():
            same = [system for system in systems if system.name == name]
            if count > 1:
                for place, system in enumerate(same):
                    system.name = f"{name} ({suffix(system, place)})"
    return systems


def _folder_name(system: System, place: int) -> str:
    home = system.members[0].checkpoint.resolve().parent.parent
    return (home.parent.parent if home.parent.name == "folds" else home).name


def _number(system: System, place: int) -> str:
    return str(place + 1)
