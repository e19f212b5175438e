"""Open a data set for training: recordings, store, folds, checks, and the card to train."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tex_lightning.baselines.classifier import make_baseline, new_classifier
from tex_lightning.classifier.card import DECISION, Card
from tex_lightning.classifier.classifier import SurfaceClassifier, Trained, read_trained
from tex_lightning.classifier.unknown import LABEL
from tex_lightning.config import Config, DataConfig
from tex_lightning.core.progress import track
from tex_lightning.data.folds import Sample, Split, check_split, make_samples, split
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.data.store import Store, Unusable, cache_root, list_files
from tex_lightning.errors import UserError, listed
from tex_lightning.inference.prediction import taken
from tex_lightning.learning.start import start_trunk
from tex_lightning.learning.trainer import try_parts_of_training
from tex_lightning.learning.trial import try_branch
from tex_lightning.networks.blocks import is_builtin
from tex_lightning.senses.base import Sense
from tex_lightning.studies.console_summary import Opening
from tex_lightning.studies.leaks import refuse_leak, trained_on, trained_on_parts


def find_unusable(
    recordings: Recordings,
    store: Store,
    senses: Iterable[Sense],
    damaged: Sequence[Unusable] | None = None,
    *,
    skip_bad: bool,
) -> list[Unusable]:
    """Find recordings that cannot be decoded, or give no fragment.

    Args:
        recordings: All that a task will need.
        store: Filled with them.
        damaged: Those that it could not be filled with; None fills it.
        senses: Branches that look at them.
        skip_bad: Whether the task goes on without them (``data.skip_bad``).

    Raises:
        UserError: Listing them, unless the task goes on.
    """
    damaged = store.fill(recordings) if damaged is None else damaged
    readable = recordings.without(each.recording for each in damaged)
    seen = [(row, sense) for sense in senses for row in readable.of(sense.modality)]
    small = [
        found
        for row, sense in track(seen, "Checking")
        if (found := _too_small(row, store, sense)) is not None
    ]
    unusable = list({each.recording: each for each in (*damaged, *small)}.values())
    if unusable and not skip_bad:
        refuse(unusable, len(recordings))
    return unusable


def refuse(unusable: list[Unusable], count: int) -> None:
    """End with the list of all files out of ``count`` that cannot be used.

    Raises:
        UserError: Always.
    """
    raise UserError(
        f"{len(unusable)} of {count} files cannot be used; repair them, take them out or set "
        "data.skip_bad=true to go on without them:",
        *list_files(unusable),
    )


def _too_small(row: Recording, store: Store, sense: Sense) -> Unusable | None:
    """A recording that is too short or too small for a single fragment."""
    try:
        sense.check(store.load(row))
    except UserError as error:
        said = f"{str(error).rstrip('.')}{_doubt(row, store, sense)}."
        return Unusable(row, f"{row.source}: {said}")
    return None


def _doubt(row: Recording, store: Store, sense: Sense) -> str:
    """Hint that a rate that no file states may be the reason."""
    if sense.medium != "signal" or (rate := store.rate(row)).source != "assumed":
        return ""
    return (
        f", or correct the rate: {rate.hz:,.6g} Hz are assumed (data.file_rate, or give the rate "
        "of this file)"
    )


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
    senses = check_networks(config)
    rows = read_recordings(data, modalities)
    needed = rows.without(row for row in rows if row.modality not in modalities)
    recordings, unknown = hold_out(needed, data.hold_out)
    decoders = {sense.modality: sense.decoder for sense in senses}
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
    for sense in senses:
        if _is_new(config, sense):
            _try_new(config, sense, recordings.without(each.recording for each in damaged), store)
    skipped = find_unusable(needed, store, senses, damaged, skip_bad=data.skip_bad)
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


def check_networks(config: Config) -> list[Sense]:
    """Build the networks, so that settings and weights that do not fit are refused at once.

    Returns:
        The senses, with weights of no meaning.

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
    return list(new_classifier(card).senses.values())


def _checked_branch(config: Config, name: str) -> Sense:
    given, source = config.model.checkpoints.get(name), config.weights_of(name)
    if given is not None:
        return SurfaceClassifier.from_checkpoint(given, name).senses[name]
    start = SurfaceClassifier(configured_card(config, [name], ["one", "other"]))
    if source is not None:
        start_trunk(start, source)
    sense, fit = start.eval().senses[name], config.model.sense(name).fit
    least = sense.known_min_size if is_builtin(sense.features) else None
    if least is not None and fit.piece < least[1]:
        raise UserError(
            f"model.{name}.fit.{fit.piece_key} is {fit.piece}, and this network needs {least[1]} "
            f"for a prediction; choose {least[1]} or more."
        )
    return sense


def _is_new(config: Config, sense: Sense) -> bool:
    """Whether a sense that is to be trained has parts of the user's."""
    given = config.model.checkpoints.get(sense.name) is not None
    augmented = config.model.fit_values(sense.name).get("augmentation") is not None
    return config.model.baseline is None and not given and (augmented or not sense.is_builtin)


def _try_new(config: Config, sense: Sense, recordings: Recordings, store: Store) -> None:
    """Try a sense as it will be trained, for the classes of the data."""
    card, model = configured_card(config, [sense.name], recordings.classes), config.model
    piece = model.sense(sense.name).fit.piece
    try_branch(card, model.fit_values(sense.name), piece, recordings, store)


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
        senses={name: starts[name].senses[name] for name in senses},
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
        senses={name: model.sense(name).node for name in senses},
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
    theirs, ours = card.senses[name]["decode"], workspace.config.model.sense(name).decode
    for key in theirs:
        if key != "file_rate" and theirs[key] != ours.get(key):
            raise UserError(
                f"Checkpoint {path} was trained with data.{key}={theirs[key]}, this "
                f"run has {ours.get(key)}; make them equal."
            )
    test = workspace.parts().test.of(card.modalities[0])
    refuse_leak(test, card, f"Checkpoint {path}", workspace.data)
    return start
