"""What every training task starts with: recordings, store, classifier card, run folder."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from tex_lightning.baselines.classifier import new_classifier
from tex_lightning.baselines.making import make_baseline
from tex_lightning.branches import Branch
from tex_lightning.card import DECISION, Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.data.folds import Sample, Split, check_split, make_samples, split
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root
from tex_lightning.data.unusable import Unusable
from tex_lightning.errors import UserError, listed
from tex_lightning.learning.start import start_trunk
from tex_lightning.runs.leaks import refuse_leak, trained_on, trained_on_parts
from tex_lightning.runs.opening import announce
from tex_lightning.runs.usable import find_unusable


@dataclass(frozen=True)
class Workspace:
    """A configuration with its recordings, ready to train on any fold.

    Attributes:
        config: The whole configuration.
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
    def kind(self) -> str:
        """What the network of all senses is called."""
        return self.config.model.kind

    def on_fold(self, fold: int, directory: Path) -> "Workspace":
        """The same with another test fold and run folder."""
        config = replace(self.config, data=replace(self.config.data, test_fold=fold))
        return replace(self, config=config, directory=directory)

    def parts(self) -> Split:
        """Training, validation and test recordings, checked."""
        data = self.config.data
        parts = split(self.recordings, data.folds, data.test_fold, data.val_fold, data.inverted)
        check_split(parts, self.classes, self.config.model.modalities, cast(int, data.test_fold))
        return parts

    def unknown_samples(self, modalities: Sequence[str]) -> list[Sample]:
        """Samples of the held-out classes in the test fold."""
        data = self.config.data
        parts = split(self.unknown, data.folds, data.test_fold, data.val_fold, data.inverted)
        return make_samples(parts.test, modalities)


def open_workspace(config: Config, directory: Path) -> Workspace:
    """Read the data set and decode what the cache does not have.

    Raises:
        UserError: If the data or the networks cannot be used.
    """
    branches, modalities = check_networks(config), config.model.modalities
    rows = read_recordings(config.data, modalities)
    needed = rows.without(row for row in rows if row.modality not in modalities)
    recordings, unknown = hold_out(needed, config.data.hold_out)
    decoders = {branch.modality: branch.decoder for branch in branches}
    store = Store(cache_root(config.data.cache_dir), decoders)
    if len(recordings.classes) < 2:
        raise UserError(
            f"The data has {' or '.join(modalities)} recordings of "
            f"{listed(recordings.classes) or 'no class'} for a {config.model.kind} network, and "
            "telling classes apart takes two; choose another model or add recordings."
        )
    skipped = find_unusable(needed, store, branches, skip_bad=config.data.skip_bad)
    bad = [each.recording for each in skipped]
    announce(config, needed.without(bad), store, skipped)
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
    if absent:
        raise UserError(
            f"data.hold_out names {listed(absent)}, and the data has no such class; choose from "
            f"{listed(recordings.classes)}."
        )
    known = [label for label in recordings.classes if label not in (classes or ())]
    return recordings.in_classes(known), recordings.in_classes(classes or [])


def check_networks(config: Config) -> list[Branch]:
    """Build what will be trained, so that settings and weights that do not fit are said at once.

    Returns:
        The branches, with weights of no meaning.

    Raises:
        UserError: Naming the key that does not fit.
    """
    model = config.model
    if model.baseline is None:
        return [_checked_branch(config, name) for name in model.senses]
    baseline = make_baseline(model.name, model.baseline, model.budget)
    if config.weights is not None:
        baseline.load_weights(config.weights)
    card = configured_card(config, model.senses, ["one", "other"])
    return list(new_classifier(card).branches.values())


def _checked_branch(config: Config, name: str) -> Branch:
    given, source = config.model.checkpoints.get(name), config.weights_of(name)
    if given is not None:
        return SurfaceClassifier.from_checkpoint(given, name).branch(name)
    start = SurfaceClassifier(configured_card(config, [name], ["one", "other"]))
    if source is not None:
        start_trunk(start, source)
    branch, fit = start.branch(name), config.model.branch(name).fit
    if branch.declares_geometry and fit.piece < (least := branch.min_size[1]):
        raise UserError(
            f"model.{name}.fit.{fit.piece_key} is {fit.piece}, and this network needs {least} for "
            f"a prediction; choose {least} or more."
        )
    return branch


def given_checkpoints(config: Config) -> dict[str, Path]:
    """The unimodal checkpoints that FusionNet is told to start from."""
    return {name: Path(path).expanduser() for name, path in config.model.checkpoints.items()}


def make_card(workspace: Workspace, senses: Sequence[str], unimodal: dict[str, Path]) -> Card:
    """Describe the classifier to train; FusionNet's branches are what their checkpoints say."""
    config, parts = workspace.config, workspace.parts()
    card = configured_card(config, senses, workspace.classes)
    ranges = {
        modality: training_ranges(parts.train.of(modality), workspace.store)
        for modality in card.modalities
    }
    card = replace(card, input_ranges=ranges)
    if not unimodal:
        source = None if card.baseline else config.weights_of(card.kind)
        return replace(card, trained_on=trained_on(card, parts, config.data, source))
    starts = {name: starting_card(workspace, name, path) for name, path in unimodal.items()}
    return replace(
        card,
        trained_on=trained_on_parts(card, parts, config.data, *starts.values()),
        branches={name: starts[name].branches[name] for name in senses},
    )


def configured_card(config: Config, senses: Sequence[str], classes: list[str]) -> Card:
    """Describe a classifier by the configuration alone, as if nothing had trained it."""
    model = config.model
    return Card(
        classes=classes,
        branches={name: model.branch(name).node for name in senses},
        decision={key: getattr(config.decision, key) for key in DECISION},
        fusion={"level": model.fusion.level} if len(senses) > 1 else {},
        baseline={} if model.baseline is None else _baseline(config),
    )


def _baseline(config: Config) -> dict[str, Any]:
    """What makes it again, and the weights it started from."""
    model = config.model
    return {
        "name": model.name,
        "node": model.baseline,
        "budget": model.budget,
        "weights": config.weights,
    }


def starting_card(workspace: Workspace, name: str, path: Path) -> Card:
    """The card of a unimodal checkpoint, if FusionNet may start from it.

    Raises:
        UserError: If it is no such network, classes or decoding differ, or it has seen the fold
            that this run tests.
    """
    card = SurfaceClassifier.from_checkpoint(path, name).card
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
    refuse_leak(workspace.parts().test.of(card.modalities[0]), card, f"Checkpoint {path}")
    return card
