"""What ``task=profile`` measures: unimodal networks, each with one recording to classify."""

from pathlib import Path
from typing import cast

import numpy as np
import torch
from torch import Tensor

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.data.decode import decode_image, decode_trace
from tex_lightning.data.folds import NEEDS, Kind
from tex_lightning.errors import UserError
from tex_lightning.networks.windows import window_size
from tex_lightning.parts import UNIMODAL, unimodal_parts
from tex_lightning.profiling.subject import Subject
from tex_lightning.runs.workspace import configured_card
from tex_lightning.synthetic import make_materials
from tex_lightning.synthetic.camera import render_photo
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import slide_tool


def make_subjects(config: Config, device: torch.device) -> list[Subject]:
    """Load or build the networks, and read or render a recording for each.

    Without a checkpoint the weights are random, drawn from ``seed``: no time depends on them.

    Raises:
        UserError: If the checkpoint or a recording cannot be used, or is for a network that is
            not there.
    """
    if config.checkpoint is None:
        kinds = UNIMODAL if config.model.kind == "fusion" else (cast(Kind, config.model.kind),)
        classes = [f"class{number}" for number in range(config.profile.classes)]
        torch.manual_seed(config.seed)
        parts = [SurfaceClassifier(configured_card(config, kind, classes)) for kind in kinds]
    else:
        parts = list(unimodal_parts(SurfaceClassifier.from_checkpoint(config.checkpoint)))
    _refuse_unused(config, [part.card.kind for part in parts])
    return [_subject(config, part.eval().to(device)) for part in parts]


def _refuse_unused(config: Config, kinds: list[Kind]) -> None:
    needed = {modality for kind in kinds for modality in NEEDS[kind]}
    for key, value in (("haptic", config.haptic), ("image", config.image)):
        if value is None:
            continue
        if key not in needed:
            raise UserError(f"{key}={value} is for a network that is not profiled; leave it out.")
        if isinstance(value, list | dict):
            raise UserError(f"task=profile takes one file, not {key}={value}; give {key}=FILE.")


def _subject(config: Config, classifier: SurfaceClassifier) -> Subject:
    trace = classifier.card.kind == "haptic"
    recording = _trace(config, classifier.card) if trace else _photo(config, classifier.card)
    if trace and config.checkpoint is None and classifier.haptic_features is not None:
        features = classifier.haptic_features
        features.fit([features.magnitudes(recording.to(features.window.device))])
    subject = Subject(classifier, recording)
    given = tuple(subject.features(classifier).shape[-2:])
    least = window_size(subject.network)
    if given[0] < least[0] or given[1] < least[1]:
        raise UserError(
            f"The {'trace gives' if trace else 'photo has'} {given[0]}x{given[1]} "
            f"{'bands and frames' if trace else 'pixels, height first'}, and one window of the "
            f"{classifier.card.kind} network takes {least[0]}x{least[1]}; give a larger recording."
        )
    return subject


def _trace(config: Config, card: Card) -> Tensor:
    if config.haptic is not None:
        path = Path(str(config.haptic)).expanduser()
        return torch.from_numpy(decode_trace(path, card.settings_for(config.data.file_rate)))
    rate = round(card.settings.sampling_rate)
    rng = np.random.default_rng(config.seed)
    return torch.from_numpy(slide_tool(_specimen(config), rng, config.profile.seconds, rate))


def _photo(config: Config, card: Card) -> Tensor:
    if config.image is not None:
        path = Path(str(config.image)).expanduser()
        return torch.from_numpy(decode_image(path, card.settings).copy())
    size = (config.profile.width, config.profile.height)
    rng = np.random.default_rng(config.seed)
    return torch.from_numpy(render_photo(_specimen(config), rng, size=size))


def _specimen(config: Config) -> Specimen:
    return Specimen(make_materials(2, config.seed)[0])
