"""Profile a network beside its sliding-window form: arithmetic and time, in one run."""

import logging
import time
from dataclasses import asdict
from typing import Any

import torch
from rich.table import Table
from torch import Tensor

from tex_lightning.classifier.card import configured_card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.devices import pick_device
from tex_lightning.core.progress import track
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import RANDOM, environment, write_results
from tex_lightning.report.table import make_table, print_tables
from tex_lightning.studies.profile import only_sense, profile_network, render_recording

WAYS = {
    "sliding_window": "CNN, windows one by one",
    "same_engine_window": "same, windows through the FCN's engine",
    "reference": "FCN as trained",
    "fcn": "FCN accelerated",
}
FACTS = {  # format of each figure by its key
    "speedup": ("speedup over windows, as trained", "{:.1f}x"),
    "speedup_same_engine": ("speedup over windows, same engine", "{:.1f}x"),
    "arithmetic_ratio": ("ratio of their arithmetic", "{:.1f}x"),
    "engine_speedup": ("accelerated over as trained", "{:.1f}x"),
    "windows": ("windows", "{}"),
    "label_agreement": ("labels as on the window alone", "{:.2%}"),
    "macs": ("multiply-accumulates", "{:,}"),
    "gemm_gflops": ("matrix products, GFLOP/s", "{:.0f}"),
    "roofline_fraction": ("share of that rate", "{:.0%}"),
}

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure ``model`` or ``checkpoint``; write ``results.json`` and return it.

    A fusion is measured as the networks that it consists of.
    """
    begin, device = time.perf_counter(), pick_device(config.trainer.accelerator)
    networks: dict[str, Any] = {}
    for classifier in track(_classifiers(config), lambda each: f"timing {each.card.title}"):
        name = classifier.card.kind
        log.info("Profiling the %s network.", name)
        classifier.eval().to(device)
        recording = _recording(config, classifier)
        networks[name] = profile_network(classifier, recording, config.engine, config.profile)
    results = {
        "task": config.task,
        "model": config.model.name,
        "weights": RANDOM if config.checkpoint is None else config.checkpoint,
        "seed": config.seed,
        "wall_seconds": time.perf_counter() - begin,
        "environment": environment(device),
        "engine": asdict(config.engine),
        "networks": networks,
    }
    write_results(job.directory / "results.json", results)
    tables = [_table(name, network, results) for name, network in networks.items()]
    print_tables(job.directory, *tables)
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


def _recording(config: Config, classifier: SurfaceClassifier) -> Tensor:
    """Render a recording; features of an untrained network learn statistics from it.

    Raises:
        UserError: If the recording is too small for a window.
    """
    sense = only_sense(classifier)
    recording = torch.from_numpy(render_recording(sense, config.profile, config.seed).copy())
    size, window = sense.input_size(recording), sense.window_size
    if size[0] < window[0] or size[1] < window[1]:
        raise UserError(
            f"The {sense.what} gives an input of {size[0]}x{size[1]}, height first, and one window "
            f"of the {sense.name} network takes {window[0]}x{window[1]}; raise profile.seconds, or "
            "profile.width and profile.height."
        )
    features: Any = sense.features
    if config.checkpoint is None and hasattr(features, "fit"):
        features.fit([features.magnitudes(recording.to(sense.device))])
    return recording


def _table(name: str, network: dict[str, Any], results: dict[str, Any]) -> Table:
    """Return the times of one network's ways of classifying, and what follows from them."""
    table = make_table(f"profile · {results['model']} · {results['weights']}", [""], [name])
    table.caption = f"ms: median (p95), threads: {results['environment']['threads']}"
    for key, way in WAYS.items():
        table.add_row(way, f"{network[f'{key}_ms']:,.1f} ({network[f'{key}_p95_ms']:,.1f})")
    for key, (fact, form) in FACTS.items():
        table.add_row(fact, form.format(network[key]))
    return table
