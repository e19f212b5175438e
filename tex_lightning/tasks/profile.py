"""Time, arithmetic and memory of each unimodal network, beside its sliding-window twin."""

import logging
import time
from dataclasses import asdict
from typing import Any

import torch

from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.devices import pick_device
from tex_lightning.core.progress import steps
from tex_lightning.evaluation.outcomes import RANDOM, environment, write_results
from tex_lightning.learning.loggers import log_profile
from tex_lightning.profiling.comparison import compare
from tex_lightning.profiling.timing import Subject, only_branch
from tex_lightning.report.figures import save_figure
from tex_lightning.report.profile_table import print_profile, ways_figure
from tex_lightning.runs.subjects import (
    learn_statistics,
    load_networks,
    make_subject,
    random_networks,
    read_recording,
    refuse_unused,
    render_recording,
)

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> dict[str, Any]:
    """Measure ``model`` or ``checkpoint``; write ``results.json`` and figures, return the results.

    A fusion is measured as the networks that it consists of.
    """
    begin, directory = time.perf_counter(), job.directory
    device = pick_device(config.trainer.accelerator)
    subjects = _subjects(config, device)
    networks: dict[str, Any] = {}
    for subject in steps(subjects, lambda each: f"timing {each.classifier.card.title}"):
        name = subject.classifier.card.kind
        log.info("Profiling the %s network.", name)
        networks[name] = compare(subject, config.engine, config.profile)
        figure = ways_figure(name, networks[name])
        save_figure(figure, directory / "figures" / f"{name}_ways", config.figures.formats)
        log_profile(config.logger, directory, name, networks[name], {"ways": figure})
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
    write_results(directory / "results.json", results)
    print_profile(results, directory)
    return results


def _subjects(config: Config, device: torch.device) -> list[Subject]:
    """Load or build the networks, and read or render a recording for each."""
    fresh = config.checkpoint is None
    networks = (
        random_networks(config, config.profile.classes)
        if config.checkpoint is None
        else load_networks(config.checkpoint)
    )
    refuse_unused(config.files, networks)
    subjects = []
    for network in networks:
        sense = only_branch(network.eval().to(device))
        if (file := config.files.get(sense.modality)) is None:
            recording = render_recording(sense, config.profile, config.seed)
        else:
            recording = read_recording(sense, str(file), config.data)
        subjects.append(make_subject(network, recording))
        if fresh:
            learn_statistics(subjects[-1])
    return subjects
