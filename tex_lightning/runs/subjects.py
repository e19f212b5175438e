"""The subjects of ``task=profile``: unimodal networks, each with one recording."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, DataConfig, ProfileConfig
from tex_lightning.data.decode import Array, SignalDecoder, to_rate
from tex_lightning.errors import UserError
from tex_lightning.profiling.timing import Subject, only_branch
from tex_lightning.runs.workspace import configured_card
from tex_lightning.senses import Sense
from tex_lightning.synthetic import make_materials
from tex_lightning.synthetic.camera import render_photo
from tex_lightning.synthetic.specimen import Specimen
from tex_lightning.synthetic.tool import slide_tool

LEAST_RATE = 2000  # Hz, of a rendered trace: the tool rings at 430 Hz


def load_networks(checkpoint: str) -> list[SurfaceClassifier]:
    """The unimodal networks of a checkpoint."""
    whole = SurfaceClassifier.from_checkpoint(checkpoint)
    return [whole.with_senses([name]) for name in whole.card.sense_names]


def random_networks(config: Config, classes: int) -> list[SurfaceClassifier]:
    """The unimodal networks of a model with random weights: no time depends on them."""
    names = [f"class{number}" for number in range(classes)]
    torch.manual_seed(config.seed)
    cards = [configured_card(config, [sense], names) for sense in config.model.senses]
    return [SurfaceClassifier(card) for card in cards]


def refuse_unused(files: Mapping[str, Any], networks: Sequence[SurfaceClassifier]) -> None:
    """Refuse recordings that no network reads.

    Raises:
        UserError: Naming one.
    """
    needed = [only_branch(network).modality for network in networks]
    for key, value in files.items():
        if key not in needed:
            raise UserError(f"{key}={value} is for a network that is not profiled; leave it out.")
        if isinstance(value, list | dict):
            raise UserError(f"task=profile takes one file, not {key}={value}; give {key}=FILE.")


def make_subject(classifier: SurfaceClassifier, recording: Array) -> Subject:
    """A network with a recording to classify.

    Raises:
        UserError: If the recording is too small for a window.
    """
    sense, tensor = only_branch(classifier), torch.from_numpy(recording.copy())
    least, given = sense.window_size, sense.input_size(tensor)
    if given[0] < least[0] or given[1] < least[1]:
        raise UserError(
            f"The {sense.what} gives an input of {given[0]}x{given[1]}, height first, and one "
            f"window of the {sense.name} network takes {least[0]}x{least[1]}; give a larger "
            "recording."
        )
    return Subject(classifier, tensor)


def learn_statistics(subject: Subject) -> None:
    """Let untrained features take their statistics from the recording."""
    sense = only_branch(subject.classifier)
    features: Any = sense.features
    if hasattr(features, "fit"):
        features.fit([features.magnitudes(subject.recording.to(sense.device))])


def read_recording(sense: Sense, file: str, data: DataConfig) -> Array:
    """Decode the file that was given."""
    decoder = sense.decoder.assuming(data.file_rate)
    return decoder.decode(Path(file).expanduser())[0]


def render_recording(sense: Sense, profile: ProfileConfig, seed: int) -> Array:
    """Render a recording of the synthetic tool or camera."""
    rng = np.random.default_rng(seed)
    specimen = Specimen(make_materials(2, seed)[0])
    if isinstance(sense.decoder, SignalDecoder):
        rate = round(sense.decoder.sampling_rate)
        rendered = max(rate, LEAST_RATE)
        trace = slide_tool(specimen, rng, profile.seconds, rendered)
        return to_rate(trace, rendered, rate, "The rendered trace")
    return render_photo(specimen, rng, size=(profile.width, profile.height))
