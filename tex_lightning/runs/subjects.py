"""What ``task=profile`` measures: unimodal networks, each with one recording to classify."""

from pathlib import Path
from typing import Any

import numpy as np
import torch

from tex_lightning.branches import Branch
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.data.decode import Array, SignalDecoder
from tex_lightning.errors import UserError
from tex_lightning.profiling.subject import Subject, only_branch
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
    parts = _networks(config)
    _refuse_unused(config, [only_branch(part).modality for part in parts])
    return [_subject(config, part.eval().to(device)) for part in parts]


def _networks(config: Config) -> list[SurfaceClassifier]:
    if config.checkpoint is not None:
        whole = SurfaceClassifier.from_checkpoint(config.checkpoint)
        return [whole.part([name]) for name in whole.card.senses]
    classes = [f"class{number}" for number in range(config.profile.classes)]
    torch.manual_seed(config.seed)
    return [
        SurfaceClassifier(configured_card(config, [name], classes)) for name in config.model.senses
    ]


def _refuse_unused(config: Config, needed: list[str]) -> None:
    for key, value in config.files.items():
        if key not in needed:
            raise UserError(f"{key}={value} is for a network that is not profiled; leave it out.")
        if isinstance(value, list | dict):
            raise UserError(f"task=profile takes one file, not {key}={value}; give {key}=FILE.")


def _subject(config: Config, classifier: SurfaceClassifier) -> Subject:
    branch = only_branch(classifier)
    least = branch.window_size
    recording = torch.from_numpy(_recording(config, branch).copy())
    given = branch.input_size(recording)
    if given[0] < least[0] or given[1] < least[1]:
        raise UserError(
            f"The {branch.what} gives an input of {given[0]}x{given[1]}, height first, and one "
            f"window of the {branch.name} network takes {least[0]}x{least[1]}; give a larger "
            "recording."
        )
    features: Any = branch.features
    if config.checkpoint is None and hasattr(features, "fit"):
        features.fit([features.magnitudes(recording.to(branch.device))])
    return Subject(classifier, recording)


def _recording(config: Config, branch: Branch) -> Array:
    """The file that is given, or what the synthetic tool or camera records."""
    file = config.files.get(branch.modality)
    if file is not None:
        decoder = branch.decoder.assuming(config.data.file_rate)
        return decoder.decode(Path(str(file)).expanduser())[0]
    profile, rng = config.profile, np.random.default_rng(config.seed)
    specimen = Specimen(make_materials(2, config.seed)[0])
    if isinstance(branch.decoder, SignalDecoder):
        return slide_tool(specimen, rng, profile.seconds, round(branch.decoder.sampling_rate))
    return render_photo(specimen, rng, size=(profile.width, profile.height))
