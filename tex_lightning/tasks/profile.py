"""Profile a network beside its sliding-window form: arithmetic and time, in one run."""

import logging
import time
from dataclasses import asdict
from typing import Any

import torch
from torch import Tensor

from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, Job
from tex_lightning.core.devices import pick_device
from tex_lightning.core.environment import environment
from tex_lightning.core.progress import track
from tex_lightning.core.run_folder import system_name
from tex_lightning.errors import UserError
from tex_lightning.networks.weights import RANDOM
from tex_lightning.report.table import make_table, print_tables, profile_table
from tex_lightning.studies.profile import only_sense, profile_network, render_recording

RECORDINGS = 3  # whose labels are compared; the first is timed

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure ``model`` or ``checkpoint``.

    A fusion is measured as the networks that it consists of.
    """
    begin, device = time.perf_counter(), pick_device(config.trainer.accelerator)
    source = config.checkpoint
    networks: dict[str, Any] = {}
    for classifier in track(_classifiers(config), lambda network: f"timing {network.card.title}"):
        name = classifier.card.kind
        log.info("Profiling the %s network.", name)
        classifier.eval().to(device)
        recordings = _recordings(config, classifier)
        networks[name] = profile_network(classifier, recordings, config.engine, config.profile)
    results: dict[str, Any] = {
        "task": config.task,
        "model": config.model.name if source is None else system_name(source),
        "weights": RANDOM if source is None else source,
        "seed": config.seed,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(device, config.trainer.precision),
        "engine": asdict(config.engine),
        "networks": networks,
    }
    profile, title = profile_table(networks), f"profile · {results['model']} · {results['weights']}"
    table = make_table(title, [""], [*networks], profile.cells)
    table.caption = f"threads: {results['environment']['threads']} {profile.text}".strip()
    print_tables(job.directory, table)
    return results


def _classifiers(config: Config) -> list[SurfaceClassifier]:
    """Load the unimodal networks of a checkpoint, or make them: no time depends on weights."""
    if config.checkpoint is not None:
        whole = SurfaceClassifier.from_checkpoint(config.checkpoint)
        return [whole.with_senses([name]) for name in whole.card.sense_names]
    names = [f"class{number}" for number in range(config.profile.classes)]
    torch.manual_seed(config.seed)
    card = configured_card(config, names)
    return [SurfaceClassifier(card.of([sense])) for sense in card.sense_names]


def _recordings(config: Config, classifier: SurfaceClassifier) -> list[Tensor]:
    """Render recordings; features of an untrained network learn statistics from the first.

    Raises:
        UserError: If they are too small for a window.
    """
    sense, seeds = only_sense(classifier), range(config.seed, config.seed + RECORDINGS)
    arrays = [render_recording(sense, config.profile, seed) for seed in seeds]
    recordings = [torch.from_numpy(array.copy()) for array in arrays]
    recording = recordings[0]
    size, window = sense.input_size(recording), sense.window_size
    if size[0] < window[0] or size[1] < window[1]:
        raise UserError(
            f"The {sense.noun} gives an input of {size[0]}x{size[1]}, height first, and one window "
            f"of the {sense.name} network takes {window[0]}x{window[1]}; raise profile.seconds, or "
            "profile.width and profile.height."
        )
    features: Any = sense.features
    if config.checkpoint is None and hasattr(features, "fit"):
        features.fit([features.magnitudes(recording.to(sense.device))])
    return recordings
