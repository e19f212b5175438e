"""What every training task starts with: recordings, store, classifier card, run folder."""

import json
import logging
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

from tex_lightning.classifier import Card, SurfaceClassifier
from tex_lightning.data.decode import DecodeSettings
from tex_lightning.data.folds import NEEDS, Kind, Split, check_split, split
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import Store, cache_root
from tex_lightning.errors import UserError
from tex_lightning.files import write_text
from tex_lightning.networks.visualnet import VisualNet
from tex_lightning.networks.weights import load_trunk_weights
from tex_lightning.schema import Config, DataConfig

log = logging.getLogger(__name__)

HAPTIC_KEYS = ("width", "norm", "dropout")
VISUAL_KEYS = ("trunk", "width", "norm", "dropout", "fc1_kernel")

# Settings that change neither weights nor figures; a run may be continued with others.
FREE_KEYS = {
    "crossval": None,
    "logger": None,
    "data": ("cache_dir", "num_workers"),
    "trainer": ("accelerator", "devices", "threads"),
}


@dataclass(frozen=True)
class Workspace:
    """A configuration with its recordings, ready to train on any fold.

    Attributes:
        config: The whole configuration.
        kind: haptic, visual or fusion.
        classes: Class names in natural order.
        recordings: Those of the modalities that the kind needs.
        store: Decoded files.
        directory: The run folder.
    """

    config: Config
    kind: Kind
    classes: list[str]
    recordings: Recordings
    store: Store
    directory: Path

    def on_fold(self, fold: int, directory: Path) -> "Workspace":
        """The same with another test fold and run folder."""
        config = replace(self.config, data=replace(self.config.data, test_fold=fold))
        return replace(self, config=config, directory=directory)

    def parts(self) -> Split:
        """Training, validation and test recordings, checked."""
        data = self.config.data
        parts = split(self.recordings, data.folds, data.test_fold, data.val_fold)
        check_split(parts, self.classes, self.kind, cast(int, data.test_fold))
        return parts


def open_workspace(config: Config, directory: Path) -> Workspace:
    """Read the data set, decode what the cache does not have, and claim the run folder.

    Raises:
        UserError: If the data cannot be used or the folder holds another run.
    """
    kind = cast(Kind, config.model.kind)
    check_networks(config)
    claim_folder(config, directory)
    rows = read_recordings(config.data)
    recordings = Recordings(tuple(row for row in rows if row.modality in NEEDS[kind]))
    store = Store(cache_root(config.data.cache_dir), decode_settings(config.data))
    if len(recordings) == 0:
        raise UserError(
            f"The data has no {' or '.join(NEEDS[kind])} recordings for a {kind} network; "
            "choose another model or add recordings."
        )
    store.fill(recordings)
    return Workspace(config, kind, recordings.classes, recordings, store, directory)


def check_networks(config: Config) -> None:
    """Build what will be trained, so that settings and weights that do not fit are said at once.

    Raises:
        UserError: Naming the key that does not fit.
    """
    model = config.model
    if model.kind != "haptic" and model.fusion.visual_checkpoint is None:
        network = VisualNet(2, **_network(model.visual, *VISUAL_KEYS))
        if config.weights is not None:
            load_trunk_weights(network, config.weights)
    if model.kind == "fusion":
        for kind, path in given_checkpoints(config).items():
            SurfaceClassifier.from_checkpoint(path, kind)


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
    return DecodeSettings(data.sampling_rate, data.file_rate, data.half_scale)


def make_card(workspace: Workspace, kind: Kind, unimodal: dict[Kind, Path]) -> Card:
    """Describe the classifier to train; FusionNet's parts are what their checkpoints say."""
    config = workspace.config
    card = Card(
        kind=kind,
        classes=workspace.classes,
        decode=decode_settings(config.data).to_dict(),
        decision=asdict(config.decision),
        haptic_features=_haptic_features(config) if kind == "haptic" else {},
        haptic_network=_network(config.model.haptic, *HAPTIC_KEYS) if kind == "haptic" else {},
        visual_network=_network(config.model.visual, *VISUAL_KEYS) if kind == "visual" else {},
        trained_on=trained_on(config),
    )
    if kind != "fusion":
        return card
    haptic = starting_card(workspace, "haptic", unimodal["haptic"])
    visual = starting_card(workspace, "visual", unimodal["visual"])
    return replace(
        card,
        haptic_features=haptic.haptic_features,
        haptic_network=haptic.haptic_network,
        visual_network=visual.visual_network,
        fusion={"level": config.model.fusion.level},
    )


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
    relevant = "sampling_rate" if kind == "haptic" else "half_scale"
    ours = decode_settings(config.data).to_dict()[relevant]
    if card.decode[relevant] != ours:
        raise UserError(
            f"Checkpoint {path} was trained with data.{relevant}={card.decode[relevant]}, this "
            f"run has {ours}; make them equal."
        )
    refuse_leak(trained_on(config), card, f"Checkpoint {path}")
    return card


def refuse_leak(ours: dict[str, Any], card: Card, who: str) -> None:
    """Refuse weights that were trained on what is to be tested.

    Args:
        ours: :func:`trained_on` of this run.
        card: Of the checkpoint.
        who: Its name in the message.

    Raises:
        UserError: Naming the fold that the checkpoint may be tested on.
    """
    theirs = card.trained_on
    same_data = all(ours[key] == theirs[key] for key in ("data", "source", "folds"))
    if same_data and ours["test_fold"] != theirs["test_fold"]:
        raise UserError(
            f"{who} was trained on every fold of this data but {theirs['test_fold']}, so testing "
            f"elsewhere would flatter it; set data.test_fold={theirs['test_fold']} or train anew."
        )


def trained_on(config: Config) -> dict[str, Any]:
    """The data and the fold that the weights have not seen."""
    data = config.data
    source = data.manifest or data.root
    return {
        "data": data.name,
        "source": None if source is None else str(Path(source).expanduser().resolve()),
        "folds": data.folds,
        "test_fold": data.test_fold,
        "val_fold": data.val_fold,
    }


def claim_folder(config: Config, directory: Path) -> None:
    """Note the settings in the run folder, or make sure that it holds a run of the same ones.

    Raises:
        UserError: If another run lives there; nothing of it is changed.
    """
    note = directory / "settings.json"
    wanted = _binding_settings(config)
    if note.is_file():
        found = json.loads(note.read_text(encoding="utf-8"))
        differing = sorted(key for key in {*wanted, *found} if wanted.get(key) != found.get(key))
        if differing:
            raise UserError(
                f"Run folder {directory} holds a run with another {', '.join(differing)}; "
                "choose another hydra.run.dir."
            )
        log.info("Going on with the run in %s.", directory)
        return
    write_text(note, json.dumps(wanted, indent=1, sort_keys=True))


def _binding_settings(config: Config) -> dict[str, Any]:
    """Dotted keys and values of everything that a continued run must keep."""
    values = asdict(config)
    for section, keys in FREE_KEYS.items():
        for key in values.pop(section) if keys is None else keys:
            if keys is not None:
                values[section].pop(key)
    return dict(_flatten(values, ""))


def _flatten(values: dict[str, Any], prefix: str) -> list[tuple[str, Any]]:
    pairs: list[tuple[str, Any]] = []
    for key, value in values.items():
        if isinstance(value, dict):
            pairs += _flatten(value, f"{prefix}{key}.")
        else:
            pairs.append((f"{prefix}{key}", value))
    return pairs


def _haptic_features(config: Config) -> dict[str, Any]:
    return {
        "sampling_rate": config.data.sampling_rate,
        "normalisation": config.model.haptic.normalisation,
        "skip_impact": config.model.haptic.skip_impact,
    }


def _network(section: object, *keys: str) -> dict[str, Any]:
    return {key: getattr(section, key) for key in keys}
