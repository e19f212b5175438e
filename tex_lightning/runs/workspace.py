"""The start of every training task: recordings, store, classifier card, run folder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tex_lightning.baselines.classifier import new_classifier
from tex_lightning.baselines.making import make_baseline
from tex_lightning.branches import Branch
from tex_lightning.card import DECISION, Card
from tex_lightning.classifier import SurfaceClassifier, Trained, read_trained
from tex_lightning.config import Config, DataConfig
from tex_lightning.data.folds import Sample, Split, check_split, make_samples, split
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root
from tex_lightning.data.unusable import Unusable
from tex_lightning.decision.unknown import LABEL
from tex_lightning.errors import UserError, listed
from tex_lightning.inference.unknown import taken
from tex_lightning.learning.start import start_trunk
from tex_lightning.learning.trainer import try_parts_of_training
from tex_lightning.learning.trial import try_branch
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.runs.leaks import refuse_leak, trained_on, trained_on_parts
from tex_lightning.runs.opening import Opening
from tex_lightning.runs.usable import find_unusable


@dataclass(frozen=True)
class Workspace:
    """Recordings and a configuration, ready to train on any fold.

    Attributes:
        config: The data, and how networks are trained on them and recorded.
        classes: Class names in natural order.
        recordings: Those of the modalities that the model needs.
        unknown: The same of the classes held out of everything but a test of their own.
        store: Decoded files.
        directory: The run folder.
        skipped: Files that were left out since they cannot be used (``data.skip_bad``).
    """

    config: Config
    classes: list[str]
    recordings: Recordings
    unknown: Recordings
    store: Store
    directory: Path
    skipped: tuple[Unusable, ...] = ()

    @property
    def data(self) -> DataConfig:
        """Where the recordings come from and how they are divided."""
        return self.config.data

    @property
    def kind(self) -> str:
        """Name of the network of all senses."""
        return self.config.model.kind

    def on_fold(self, fold: int, directory: Path) -> "Workspace":
        """Copy it with another test fold and run folder."""
        data = replace(self.data, test_fold=fold)
        return replace(self, config=replace(self.config, data=data), directory=directory)

    def parts(self) -> Split:
        """Training, validation and test recordings, checked."""
        parts = split(self.recordings, self.data)
        check_split(parts, self.classes, self.config.model.modalities, self.data)
        return parts

    def unknown_samples(self, modalities: Sequence[str]) -> list[Sample]:
        """Samples of the held-out classes in the test fold."""
        return make_samples(split(self.unknown, self.data).test, modalities)


def open_workspace(config: Config, directory: Path, opening: Opening) -> Workspace:
    """Read the data set and decode what the cache does not have.

    Args:
        config: Where recordings come from, and the networks to train on them.
        directory: The run folder.
        opening: Says what was found.

    Raises:
        UserError: If the data or the networks cannot be used.
    """
    try_parts_of_training(config, directory)
    data, modalities = config.data, config.model.modalities
    branches = check_networks(config)
    rows = read_recordings(data, modalities)
    needed = rows.without(row for row in rows if row.modality not in modalities)
    recordings, unknown = hold_out(needed, data.hold_out)
    decoders = {branch.modality: branch.decoder for branch in branches}
    store = Store(cache_root(data.cache_dir), decoders)
    if len(recordings.classes) < 2:
        raise UserError(
            f"The data has {' or '.join(modalities)} recordings of "
            f"{listed(recordings.classes) or 'no class'} for a {config.model.kind} network, and "
            "telling classes apart takes two; choose another model or add recordings."
        )
    if config.decision.unknown and LABEL in recordings.classes:
        raise taken("The data has")
    damaged = store.fill(needed)
    for branch in branches:
        if _is_new(config, branch):
            _try_new(config, branch, recordings.without(each.recording for each in damaged), store)
    skipped = find_unusable(needed, store, branches, damaged, skip_bad=data.skip_bad)
    bad = [each.recording for each in skipped]
    opening.announce(needed.without(bad), store, skipped)
    return Workspace(
        config,
        recordings.classes,
        recordings.without(bad),
        unknown.without(bad),
        store,
        directory,
        tuple(skipped),
    )


def hold_out(recordings: Recordings, classes: list[str] | None) -> tuple[Recordings, Recordings]:
    """Divide recordings into those of known classes and those of the classes named.

    Raises:
        UserError: If there is no such class.
    """
    absent = sorted(set(classes or ()) - set(recordings.classes))
    if joined := next((each for each in absent if {*each.split()} <= {*recordings.classes}), None):
        raise UserError(
            f"data.hold_out names {joined} as one class; put commas between names: "
            f"data.hold_out=[{','.join(joined.split())}]."
        )
    if absent:
        raise UserError(
            f"data.hold_out names {listed(absent)}, and the data has no such class; choose from "
            f"{listed(recordings.classes)}."
        )
    known = [label for label in recordings.classes if label not in (classes or ())]
    return recordings.in_classes(known), recordings.in_classes(classes or [])


def check_networks(config: Config) -> list[Branch]:
    """Build the networks, so that settings and weights that do not fit are refused at once.

    Returns:
        The branches, with weights of no meaning.

    Raises:
        UserError: Naming the key that does not fit.
    """
    model = config.model
    if model.baseline is None:
        return [_checked_branch(config, name) for name in model.senses]
    baseline = make_baseline(model.name, model.baseline, model.budget)
    if config.baseline_weights is not None:
        baseline.load_weights(config.baseline_weights)
    card = configured_card(config, model.senses, ["one", "other"])
    return list(new_classifier(card).branches.values())


def _checked_branch(config: Config, name: str) -> Branch:
    given, source = config.model.checkpoints.get(name), config.weights_of(name)
    if given is not None:
        return SurfaceClassifier.from_checkpoint(given, name).branch(name)
    start = SurfaceClassifier(configured_card(config, [name], ["one", "other"]))
    if source is not None:
        start_trunk(start, source)
    branch, fit = start.eval().branch(name), config.model.branch(name).fit
    least = branch.known_min_size if is_builtin(branch.features) else None
    if least is not None and fit.piece < least[1]:
        raise UserError(
            f"model.{name}.fit.{fit.piece_key} is {fit.piece}, and this network needs {least[1]} "
            f"for a prediction; choose {least[1]} or more."
        )
    return branch


def _is_new(config: Config, branch: Branch) -> bool:
    """Whether a branch that is to be trained has parts of the user's."""
    given = config.model.checkpoints.get(branch.name) is not None
    augmented = config.model.fit_values(branch.name).get("augmentation") is not None
    return config.model.baseline is None and not given and (augmented or not branch.is_builtin)


def _try_new(config: Config, branch: Branch, recordings: Recordings, store: Store) -> None:
    """Try a branch as it will be trained, for the classes of the data."""
    card, model = configured_card(config, [branch.name], recordings.classes), config.model
    piece = model.branch(branch.name).fit.piece
    try_branch(card, model.fit_values(branch.name), piece, recordings, store)


def make_card(workspace: Workspace, senses: Sequence[str], unimodal: dict[str, Trained]) -> Card:
    """Describe the classifier to train; FusionNet's branches are those of its networks."""
    data, config, parts = workspace.data, workspace.config, workspace.parts()
    card = configured_card(config, senses, workspace.classes)
    ranges = {
        modality: training_ranges(parts.train.of(modality), workspace.store)
        for modality in card.modalities
    }
    card = replace(card, input_ranges=ranges)
    if not unimodal:
        source = None if card.baseline else config.start_of(card.kind)
        return replace(card, trained_on=trained_on(card, parts, data, source))
    starts = {name: start.classifier.card for name, start in unimodal.items()}
    return replace(
        card,
        trained_on=trained_on_parts(card, parts, data, *starts.values()),
        branches={name: starts[name].branches[name] for name in senses},
    )


def configured_card(config: Config, senses: Sequence[str], classes: list[str]) -> Card:
    """Describe a classifier by its recipe alone, as if nothing had trained it."""
    model = config.model
    baseline = {
        "name": model.name,
        "node": model.baseline,
        "budget": model.budget,
        "weights": config.baseline_weights,
    }
    return Card(
        classes=classes,
        branches={name: model.branch(name).node for name in senses},
        decision={key: getattr(config.decision, key) for key in DECISION},
        fusion={"level": model.fusion.level} if len(senses) > 1 else {},
        baseline={} if model.baseline is None else baseline,
    )


def given_start(workspace: Workspace, name: str, path: Path) -> Trained:
    """Read a unimodal checkpoint, if FusionNet may start from it.

    Raises:
        UserError: If it is no such network, classes or decoding differ, or it has seen the fold
            that this run tests.
    """
    start = read_trained(path, name)
    card = start.classifier.card
    if card.classes != workspace.classes:
        raise UserError(
            f"Checkpoint {path} knows {len(card.classes)} classes that are not the "
            f"{len(workspace.classes)} of this data; train it on the same data."
        )
    theirs, ours = card.branches[name]["decode"], workspace.config.model.branch(name).decode
    for key in theirs:
        if key != "file_rate" and theirs[key] != ours.get(key):
            raise UserError(
                f"Checkpoint {path} was trained with data.{key}={theirs[key]}, this "
                f"run has {ours.get(key)}; make them equal."
            )
    test = workspace.parts().test.of(card.modalities[0])
    refuse_leak(test, card, f"Checkpoint {path}", workspace.data)
    return start
