"""What types cannot say of a configuration: ranges, choices, and keys that need each other.

Everything is checked before any work, and all complaints are made at once.
"""

import difflib
from collections.abc import Iterator, Sequence

from omegaconf import DictConfig, OmegaConf

from tex_lightning.baselines.registry import BASELINES
from tex_lightning.decision.voting import RULES
from tex_lightning.errors import UserError
from tex_lightning.learning.callbacks.fusion import LEAST_FACTOR, MOST_FACTOR
from tex_lightning.perturbations.augment import trainable
from tex_lightning.perturbations.table import perturbations
from tex_lightning.schema import Config, DataConfig, FitConfig, ModelConfig

CHOICES = {
    "optimizer": ("adam", "adamw"),
    "schedule": ("onecycle", "step"),
    "norm": ("batch", "lrn", "none"),
    "normalisation": ("standard", "paper"),
    "axes": ("frame", "trace"),
    "level": ("fc2", "fc3"),
    "head_start": ("scores", "random"),
    "layout": ("folder", "tum"),
    "split": ("training", "testing"),
    "group_by": ("patch", "surface"),
    "accelerator": ("auto", "cpu", "gpu", "cuda", "mps"),
    "precision": ("32-true", "16-mixed", "bf16-mixed", "64-true"),
    "engine": ("fp32", "bf16"),
    "rule": tuple(RULES),
    "decision": ("max_vote", "sequential"),
}

AUTO = "auto"
READ_CHECKPOINTS = ("evaluate", "predict", "profile", "stream")
LEAST_TILE = 100_000  # smaller pieces are nearly all margin
LEAST_TRACE_S, MOST_TRACE_S = 3, 600  # one full window behind the impact; what the renderer makes
LEAST_SIDE, MOST_SIDE = 224, 8192  # one patch; what the renderer makes


def check_missing(composed: DictConfig) -> None:
    """Refuse a configuration with open ``???`` values, naming all of them."""
    missing = sorted(OmegaConf.missing_keys(composed))
    if missing:
        example = " ".join(f"{key}=VALUE" for key in missing)
        raise UserError(f"No value for {', '.join(missing)}; add {example} to the command.")


def check_known(composed: DictConfig) -> None:
    """Refuse keys that were added with ``+`` and that nothing would read."""
    unknown = list(_unknown(composed, OmegaConf.structured(Config), ""))
    if unknown:
        raise UserError(
            f"There is no key {', '.join(unknown)}; `python -m tex_lightning --help` lists all."
        )


def _unknown(given: DictConfig, known: DictConfig, prefix: str) -> Iterator[str]:
    for key in map(str, given):
        if key not in known.keys():  # noqa: SIM118  (`in known` is false for open values)
            yield f"{prefix}{key}"
        elif OmegaConf.get_type(known, key) is dict:
            continue  # a baseline's settings, which it checks itself
        elif OmegaConf.is_dict(known._get_node(key)) and not OmegaConf.is_missing(given, key):
            yield from _unknown(given[key], known[key], f"{prefix}{key}.")


def check_config(config: Config, tasks: Sequence[str]) -> None:
    """Refuse values that cannot be meant, naming all of them in one sentence."""
    complaints = [
        *_choice("task", config.task, tasks),
        *_data(config.data),
        *_model(config.model),
        *_choice("generate.layout", config.generate.layout, CHOICES["layout"]),
        *_choice("trainer.accelerator", config.trainer.accelerator, CHOICES["accelerator"]),
        *_choice("trainer.precision", config.trainer.precision, CHOICES["precision"]),
        *_least("trainer.devices", config.trainer.devices, 1),
        *_least("trainer.num_nodes", config.trainer.num_nodes, 1),
        *_least("trainer.threads", config.trainer.threads, 1),
        *_choice("engine.precision", config.engine.precision, CHOICES["engine"]),
        *_least("engine.tile", config.engine.tile, LEAST_TILE),
        *_decision(config),
        *_profile(config),
        *_stability(config),
        *_positive("stream.chunk", config.stream.chunk),
        *_stream_axes(config.stream.axes),
        *_least("top_k", config.top_k, 1),
        *_least("seed", config.seed, 0),
        *_most("seed", config.seed, 2**32 - 1),
        *_task(config),
    ]
    if complaints:
        raise UserError("; ".join(complaints) + ".")


def check_shares(config: Config, processes: int) -> None:
    """Refuse batches that ``processes`` processes cannot share evenly.

    Raises:
        UserError: Naming the batch sizes.
    """
    model = config.model
    given = (model.fusion.haptic_checkpoint, model.fusion.visual_checkpoint)
    parts = [kind for kind, path in zip(("haptic", "visual"), given, strict=True) if not path]
    complaints: list[str] = []
    for kind in (*parts, "fusion") if model.kind == "fusion" else (model.kind,):
        size = getattr(model, kind).fit.batch_size
        # the statistics of one sample at one position are no statistics
        normalised = kind != "fusion" and getattr(model, kind).norm == "batch"
        least = 2 if normalised and processes > 1 else 1
        if size % processes or size < least * processes:
            complaints.append(
                f"model.{kind}.fit.batch_size is {size}, but {processes} processes share every "
                f"batch: choose a multiple of {processes}, {least * processes} or more"
            )
    if complaints:
        raise UserError("; ".join(complaints) + ".")


def _task(config: Config) -> Iterator[str]:
    data = config.data
    if config.task == "fit" and data.test_fold is None:
        yield "data.test_fold is null, but task=fit tests on a fold: give its number"
    training = config.task in ("fit", "crossval", "frontier")
    if not training and (config.trainer.devices, config.trainer.num_nodes) != (1, 1):
        yield (
            f"several devices are used when training, not by task={config.task}: leave out "
            "trainer=ddp, trainer.devices and trainer.num_nodes"
        )
    if config.checkpoint is not None and config.task not in READ_CHECKPOINTS:
        yield (
            f"checkpoint is given, but task={config.task} does not read it: use task=evaluate, "
            "task=predict, task=profile, task=stream or model.fusion.haptic_checkpoint"
        )
    if config.task == "stream" and (config.haptic is None or config.image is not None):
        yield "task=stream reads one trace and no image: give haptic=FILE, or haptic=- for a pipe"
    files = config.haptic is not None or config.image is not None
    if files and config.task not in ("predict", "profile", "stream"):
        yield f"haptic and image are read by task=predict and task=profile, not task={config.task}"
    if config.predict.fast_decode and config.task != "predict":
        yield f"predict.fast_decode is read by task=predict alone, not by task={config.task}"
    yield from _frontier(config)
    if config.weights is not None and not training:
        yield f"weights are read when training, not by task={config.task}: leave it null"
    fusion = config.model.fusion
    if config.task == "crossval" and (fusion.haptic_checkpoint or fusion.visual_checkpoint):
        yield (
            "unimodal checkpoints fit one fold only, so task=crossval cannot start from them: "
            "leave model.fusion.haptic_checkpoint and visual_checkpoint null"
        )
    if config.task == "crossval" and data.val_fold is not None:
        yield (
            "data.val_fold is set, but task=crossval trains on all folds but the tested one: "
            "leave it null"
        )
    if (
        config.weights is not None
        and config.model.kind == "haptic"
        and config.task != "frontier"  # whose family may have networks on photos
    ):
        yield "weights belong to the visual trunk, which model=haptic does not have: leave it null"
    if config.weights is not None and config.model.fusion.visual_checkpoint is not None:
        yield "weights and model.fusion.visual_checkpoint both fill the visual trunk: give one"


def _frontier(config: Config) -> Iterator[str]:
    frontier = config.frontier
    if config.model.name == AUTO and config.task not in ("fit", "frontier"):
        yield f"model=auto trains one network, task={config.task} does not: use task=fit"
    if frontier.run is not None and config.model.name != AUTO:
        yield "frontier.run is read by model=auto alone: leave it out"
    yield from _least("frontier.rounds", frontier.rounds, 1)
    if frontier.max_latency_ms is not None:
        yield from _positive("frontier.max_latency_ms", frontier.max_latency_ms)
    if frontier.min_accuracy is not None:
        yield from _within("frontier.min_accuracy", frontier.min_accuracy, 0, 1)
    for key in ("only", "max_latency_ms", "min_accuracy"):
        if getattr(frontier, key) is not None and config.task != "frontier":
            yield f"frontier.{key} is read by task=frontier alone, not by task={config.task}"


def _decision(config: Config) -> Iterator[str]:
    decision = config.decision
    yield from _choice("decision.name", decision.name, CHOICES["decision"])
    yield from _choice("decision.rule", decision.rule, CHOICES["rule"])
    if decision.name == "sequential" and decision.rule != "vote":
        yield "decision=sequential counts votes, and decision.rule=mean does not: choose one"
    yield from _least("decision.pairs", decision.pairs, 1)
    yield from _least("decision.seed", decision.seed, 0)
    yield from _most("decision.seed", decision.seed, 2**32 - 1)
    for key in ("alpha", "disagreement", "confidence"):
        if not 0 <= (value := getattr(decision, key)) < 1:
            yield f"decision.{key} is {value:g}: choose from 0 up to 1"
    for alpha in decision.alphas:
        if not 0 <= alpha < 1:
            yield f"decision.alphas has {alpha:g}: choose from 0 up to 1"
    for enough in (decision.enough, *decision.enoughs):
        yield from _within("decision.enough", enough, 0, 1)
    if decision.reject_below is not None:
        yield from _within("decision.reject_below", decision.reject_below, 0, 1)
    if decision.name == "sequential" and config.model.baseline is not None:
        yield (
            "decision=sequential needs a network, and a baseline looks at the whole recording at "
            "once: use decision=max_vote"
        )
    if decision.name == "sequential" and config.task in ("profile", "stream"):
        yield f"decision=sequential is not read by task={config.task}: leave it out"
    if config.data.hold_out and config.task not in ("fit", "crossval", "evaluate"):
        yield f"data.hold_out is not read by task={config.task}: leave it out"


def _stream_axes(axes: int) -> Iterator[str]:
    if axes not in (1, 3):
        yield f"stream.axes is {axes}: choose 1 or 3"


def _profile(config: Config) -> Iterator[str]:
    profile = config.profile
    yield from _within("profile.classes", profile.classes, 2, 100_000)
    yield from _within("profile.seconds", profile.seconds, LEAST_TRACE_S, MOST_TRACE_S)
    for side in ("width", "height"):
        yield from _within(f"profile.{side}", getattr(profile, side), LEAST_SIDE, MOST_SIDE)
    yield from _least("profile.rounds", profile.rounds, 1)
    for name in ("budget_s", "max_seconds"):
        yield from _positive(f"profile.{name}", getattr(profile, name))
    if profile.growth and config.task != "profile":
        yield f"profile.growth is read by task=profile alone, not by task={config.task}"


def _stability(config: Config) -> Iterator[str]:
    stability, testing = config.stability, config.task == "stability"
    if testing and not stability.systems:
        yield "stability.systems names nothing: give run folders or checkpoints, e.g. [RUN]"
    if stability.systems and not testing:
        yield f"stability.systems is read by task=stability alone, not by task={config.task}"
    for name in stability.only or []:
        yield from _choice("stability.only", name, tuple(perturbations()))
    if stability.only is not None and not stability.only:
        yield "stability.only names nothing: leave it null for all perturbations"
    for fold in stability.folds or []:
        yield from _within("stability.folds", fold, 0, config.data.folds - 1)
    yield from _least("stability.limit", stability.limit, 1)
    yield from _least("stability.bisections", stability.bisections, 0)
    if not 0 < stability.bound <= 1:
        yield f"stability.bound is {stability.bound:g}: choose a share above 0 and up to 1"


READ_KEYS = {
    "synthetic": (),
    "folder": ("root",),
    "manifest": ("manifest",),
    "tum": ("root", "manifest"),
    "lmt108": ("root", "split"),
    "kylberg": ("root", "group_by"),
    "kth_tips2b": ("root",),
}
SURFACES = 4  # from which Kylberg's patches of one class are cut


def _data(data: DataConfig) -> Iterator[str]:
    for key in ("root", "manifest", "split", "group_by"):
        if getattr(data, key) is not None and key not in READ_KEYS[data.name]:
            readers = [name for name, keys in READ_KEYS.items() if key in keys]
            yield (
                f"data.{key} is given, but data={data.name} does not read it: use data={readers[0]}"
            )
    for key in ("split", "group_by"):
        if (value := getattr(data, key)) is not None:
            yield from _choice(f"data.{key}", value, CHOICES[key])
    if data.group_by == "surface" and data.folds != SURFACES:
        yield (
            f"data.group_by=surface makes a fold of each source surface, but data.folds is "
            f"{data.folds}: give data.folds={SURFACES}"
        )
    if data.resize is not None and data.half_scale:
        yield "data.half_scale and data.resize both decide the size of photos: turn one off"
    yield from _least("data.resize", data.resize, 1)
    if data.inverted and data.test_fold is None:
        yield "data.inverted trains on data.test_fold, which is null: give its number"
    yield from _least("data.folds", data.folds, 2)
    for name in ("test_fold", "val_fold"):
        fold = getattr(data, name)
        if fold is not None and not 0 <= fold < data.folds:
            yield f"data.{name} is {fold}: choose from 0 to {data.folds - 1}"
    if data.val_fold is not None and data.val_fold == data.test_fold:
        yield f"data.val_fold and data.test_fold are both {data.val_fold}: choose different folds"
    yield from _least("data.classes", data.classes, 2)
    yield from _least("data.num_workers", data.num_workers, 0)
    yield from _least("data.sampling_rate", data.sampling_rate, 2000)
    if data.file_rate is not None:
        yield from _positive("data.file_rate", data.file_rate)


def _model(model: ModelConfig) -> Iterator[str]:
    yield from _choice("model.kind", model.kind, ("haptic", "visual", "fusion"))
    yield from _positive("model.budget", model.budget)
    if model.baseline is None:
        if model.settings:
            yield "model.settings belong to a baseline, and this model has none: leave them out"
    else:
        yield from _choice("model.baseline", model.baseline, tuple(BASELINES))
    yield from _choice("model.haptic.norm", model.haptic.norm, CHOICES["norm"])
    yield from _choice("model.visual.norm", model.visual.norm, CHOICES["norm"])
    known = CHOICES["normalisation"]
    yield from _choice("model.haptic.normalisation", model.haptic.normalisation, known)
    yield from _choice("model.haptic.axes", model.haptic.axes, CHOICES["axes"])
    yield from _choice("model.fusion.level", model.fusion.level, CHOICES["level"])
    starts = CHOICES["head_start"]
    yield from _choice("model.fusion.head_start", model.fusion.head_start, starts)
    probe = model.visual.fit.probe
    yield from _least("model.visual.fit.probe.steps", probe.steps, 0)
    yield from _least("model.visual.fit.probe.passes", probe.passes, 1)
    yield from _least("model.visual.fit.probe.batch_size", probe.batch_size, 1)
    yield from _positive("model.visual.fit.probe.learning_rate", probe.learning_rate)
    for name in ("haptic", "visual"):
        section = getattr(model, name)
        yield from _positive(f"model.{name}.width", section.width)
        if not 0 <= section.dropout < 1:
            yield f"model.{name}.dropout is {section.dropout}: choose from 0 up to 1"
    if len(model.visual.head) != 2 or min(model.visual.head) < 1:
        yield f"model.visual.head is {list(model.visual.head)}: give channels of FC1 and FC2"
    yield from _least("model.haptic.fit.frames", model.haptic.fit.frames, 177)
    for name in ("visual", "fusion"):
        rotation = getattr(model, name).fit.rotation
        if not 0 <= rotation <= 180:
            yield f"model.{name}.fit.rotation is {rotation}: choose from 0 to 180 degrees"
    for name in model.haptic.fit.perturb:
        yield from _choice("model.haptic.fit.perturb", name, trainable("haptic"))
    yield from _least("model.haptic.fit.perturbed_copies", model.haptic.fit.perturbed_copies, 1)
    for name in model.visual.fit.perturb:
        yield from _choice("model.visual.fit.perturb", name, trainable("image"))
    share = model.visual.fit.perturbed_share
    yield from _within("model.visual.fit.perturbed_share", share, 0, 1)
    dropped = model.fusion.fit.modality_dropout
    yield from _within("model.fusion.fit.modality_dropout", dropped, 0, 1)
    for name in ("haptic", "visual", "fusion"):
        yield from _fit(f"model.{name}.fit", getattr(model, name).fit)
    factor = model.fusion.fit.head_factor
    if model.kind == "fusion" and not LEAST_FACTOR <= factor <= MOST_FACTOR:
        yield (
            f"model.fusion.fit.head_factor is {factor:g}: choose from {LEAST_FACTOR:g} to "
            f"{MOST_FACTOR:g}"
        )


def _fit(key: str, fit: FitConfig) -> Iterator[str]:
    for name in ("epochs", "steps_per_epoch", "batch_size", "step_every"):
        yield from _least(f"{key}.{name}", getattr(fit, name), 1)
    for name in ("learning_rate", "gamma", "head_factor"):
        yield from _positive(f"{key}.{name}", getattr(fit, name))
    yield from _least(f"{key}.weight_decay", fit.weight_decay, 0)
    if not 0 <= fit.label_smoothing < 1:
        yield f"{key}.label_smoothing is {fit.label_smoothing}: choose from 0 up to 1"
    yield from _choice(f"{key}.optimizer", fit.optimizer, CHOICES["optimizer"])
    yield from _choice(f"{key}.schedule", fit.schedule, CHOICES["schedule"])


def _choice(key: str, value: str, allowed: Sequence[str]) -> Iterator[str]:
    if value not in allowed:
        near = difflib.get_close_matches(value, allowed, n=1)
        hint = f" (did you mean {near[0]}?)" if near else ""
        yield f"{key} is {value}{hint}: choose {', '.join(allowed)}"


def _least(key: str, value: float | None, least: float) -> Iterator[str]:
    if value is not None and not value >= least:
        yield f"{key} is {value:g}: choose {least:g} or more"


def _most(key: str, value: float, most: float) -> Iterator[str]:
    if value > most:
        yield f"{key} is {value}: choose {most} or less"


def _within(key: str, value: float, least: float, most: float) -> Iterator[str]:
    if not least <= value <= most:
        yield f"{key} is {value:g}: choose from {least:g} to {most:g}"


def _positive(key: str, value: float) -> Iterator[str]:
    if not 0 < value < float("inf"):
        yield f"{key} is {value:g}: choose a positive number"
