"""What every training task starts with: recordings, store, classifier card, run folder."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

from tex_lightning.baselines.making import make_baseline
from tex_lightning.card import DECISION, Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import Config, DataConfig, ModelConfig
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.data.folds import NEEDS, Kind, Sample, Split, check_split, make_samples, split
from tex_lightning.data.quality import training_ranges
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root
from tex_lightning.data.unusable import Unusable
from tex_lightning.errors import UserError, listed
from tex_lightning.features.spectrogram import HapticFeatures
from tex_lightning.learning.start import start_trunk
from tex_lightning.parts import UNIMODAL
from tex_lightning.runs.leaks import refuse_leak, trained_on, trained_on_parts
from tex_lightning.runs.opening import announce
from tex_lightning.runs.usable import find_unusable

HAPTIC_KEYS = ("width", "norm", "dropout")
VISUAL_KEYS = ("trunk", "width", "norm", "dropout", "fc1_kernel", "head")


@dataclass(frozen=True)
class Workspace:
    """A configuration with its recordings, ready to train on any fold.

    Attributes:
        config: The whole configuration.
        kind: haptic, visual or fusion.
        classes: Class names in natural order.
        recordings: Those of the modalities that the kind needs.
        unknown: The same of the classes held out of everything but a test of their own.
        store: Decoded files.
        directory: The run folder.
        skipped: Files that were left out since they cannot be used (``data.skip_bad``).
    """

    config: Config
    kind: Kind
    classes: list[str]
    recordings: Recordings
    unknown: Recordings
    store: Store
    directory: Path
    skipped: tuple[Unusable, ...] = ()

    def on_fold(self, fold: int, directory: Path) -> "Workspace":
        """The same with another test fold and run folder."""
        config = replace(self.config, data=replace(self.config.data, test_fold=fold))
        return replace(self, config=config, directory=directory)

    def parts(self) -> Split:
        """Training, validation and test recordings, checked."""
        data = self.config.data
        parts = split(self.recordings, data.folds, data.test_fold, data.val_fold, data.inverted)
        check_split(parts, self.classes, self.kind, cast(int, data.test_fold))
        return parts

    def unknown_samples(self, kind: Kind) -> list[Sample]:
        """Samples of the held-out classes in the test fold."""
        data = self.config.data
        parts = split(self.unknown, data.folds, data.test_fold, data.val_fold, data.inverted)
        return make_samples(parts.test, kind)


def open_workspace(config: Config, directory: Path) -> Workspace:
    """Read the data set and decode what the cache does not have.

    Raises:
        UserError: If the data or the networks cannot be used.
    """
    kind = cast(Kind, config.model.kind)
    min_side = _check_networks(config)
    rows = read_recordings(config.data)
    needed = rows.without(row for row in rows if row.modality not in NEEDS[kind])
    recordings, unknown = hold_out(needed, config.data.hold_out)
    store = Store(cache_root(config.data.cache_dir), decode_settings(config.data))
    if len(recordings.classes) < 2:
        raise UserError(
            f"The data has {' or '.join(NEEDS[kind])} recordings of "
            f"{listed(recordings.classes) or 'no class'} for a {kind} network, and telling "
            "classes apart takes two; choose another model or add recordings."
        )
    features = HapticFeatures(**_haptic_features(config))
    skipped = find_unusable(needed, store, features, min_side, skip_bad=config.data.skip_bad)
    bad = [each.recording for each in skipped]
    announce(config, needed.without(bad), store, skipped)
    return Workspace(
        config,
        kind,
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


def _check_networks(config: Config) -> int:
    """Build what will be trained, so that settings and weights that do not fit are said at once.

    Returns:
        The smallest side in pixels that a photo may have; 0 for traces.

    Raises:
        UserError: Naming the key that does not fit.
    """
    model = config.model
    if model.baseline is not None:
        baseline = make_baseline(model.name, model.baseline, model.budget)
        if config.weights is not None:
            baseline.load_weights(config.weights)
        return baseline.min_side
    given = given_checkpoints(config) if model.kind == "fusion" else {}
    starts = {kind: SurfaceClassifier.from_checkpoint(path, kind) for kind, path in given.items()}
    for kind in UNIMODAL if model.kind == "fusion" else (cast(Kind, model.kind),):
        source = config.weights_of(kind)
        if kind in starts or (kind == "haptic" and source is None):
            continue
        starts[kind] = SurfaceClassifier(configured_card(config, kind, ["one", "other"]))
        if source is not None:
            start_trunk(starts[kind], source)
    min_side = starts["visual"].min_side if "visual" in starts else 0
    patch = model.visual.fit.patch
    if "visual" in starts and "visual" not in given and patch < min_side:
        raise UserError(
            f"model.visual.fit.patch is {patch}, and this network needs {min_side} pixels for a "
            f"prediction; choose {min_side} or more."
        )
    return min_side


def given_checkpoints(config: Config) -> dict[Kind, Path]:
    """The unimodal checkpoints that FusionNet is told to start from."""
    fusion = config.model.fusion
    given: dict[Kind, str | None] = {
        "haptic": fusion.haptic_checkpoint,
        "visual": fusion.visual_checkpoint,
    }
    return {kind: Path(path).expanduser() for kind, path in given.items() if path}


def decode_settings(data: DataConfig) -> DecodeSettings:
    """How the configured data is decoded."""
    file_rate = data.sampling_rate if data.file_rate is None else data.file_rate
    return DecodeSettings(data.sampling_rate, file_rate, data.half_scale, data.resize)


def make_card(workspace: Workspace, kind: Kind, unimodal: dict[Kind, Path]) -> Card:
    """Describe the classifier to train; FusionNet's parts are what their checkpoints say."""
    config, parts = workspace.config, workspace.parts()
    rows = [row for row in parts.train if row.modality in NEEDS[kind]]
    ranges = training_ranges(rows, workspace.store)
    card = replace(configured_card(config, kind, workspace.classes), input_ranges=ranges)
    if kind != "fusion":
        source = None if card.baseline else config.weights_of(kind)
        return replace(card, trained_on=trained_on(card, parts, config.data, source))
    haptic = starting_card(workspace, "haptic", unimodal["haptic"])
    visual = starting_card(workspace, "visual", unimodal["visual"])
    return replace(
        card,
        trained_on=trained_on_parts(card, parts, config.data, haptic, visual),
        haptic_features=haptic.haptic_features,
        haptic_network=haptic.haptic_network,
        visual_network=visual.visual_network,
        fusion={"level": config.model.fusion.level},
    )


def configured_card(config: Config, kind: Kind, classes: list[str]) -> Card:
    """Describe a unimodal classifier by the configuration alone, as if nothing had trained it."""
    model, network = config.model, config.model.baseline is None
    return Card(
        kind=kind,
        classes=classes,
        decode=decode_settings(config.data).to_dict(),
        decision={key: getattr(config.decision, key) for key in DECISION},
        haptic_features=_haptic_features(config) if kind == "haptic" else {},
        haptic_network=_network(model.haptic, *HAPTIC_KEYS) if network and kind == "haptic" else {},
        visual_network=_network(model.visual, *VISUAL_KEYS) if network and kind == "visual" else {},
        baseline={} if network else _baseline(model, config.weights),
    )


def _baseline(model: ModelConfig, weights: str | None) -> dict[str, Any]:
    """What makes it again, and the weights it started from."""
    return {
        "name": model.name,
        "node": model.baseline,
        "budget": model.budget,
        "weights": weights,
    }


def starting_card(workspace: Workspace, kind: Kind, path: Path) -> Card:
    """The card of a unimodal checkpoint, if FusionNet may start from it.

    Raises:
        UserError: If it is no such network, classes or decoding differ, or it has seen the fold
            that this run tests.
    """
    config = workspace.config
    card = SurfaceClassifier.from_checkpoint(path, kind).card
    if card.classes != workspace.classes:
        raise UserError(
            f"Checkpoint {path} knows {len(card.classes)} classes that are not the "
            f"{len(workspace.classes)} of this data; train it on the same data."
        )
    theirs, ours = card.settings.to_dict(), decode_settings(config.data).to_dict()
    for key in ("sampling_rate",) if kind == "haptic" else ("half_scale", "resize"):
        if theirs[key] != ours[key]:
            raise UserError(
                f"Checkpoint {path} was trained with data.{key}={theirs[key]}, this "
                f"run has {ours[key]}; make them equal."
            )
    refuse_leak(workspace.parts().test.of(NEEDS[kind][0]), card, f"Checkpoint {path}")
    return card


def _haptic_features(config: Config) -> dict[str, Any]:
    return {
        "sampling_rate": config.data.sampling_rate,
        "normalisation": config.model.haptic.normalisation,
        "skip_impact": config.model.haptic.skip_impact,
        "axes": config.model.haptic.axes,
        "scale": config.model.haptic.scale,
    }


def _network(section: object, *keys: str) -> dict[str, Any]:
    return {key: getattr(section, key) for key in keys}
