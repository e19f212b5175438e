"""Checks of each task, and of the keys that only one task reads."""

from collections.abc import Iterator
from operator import attrgetter
from pathlib import PurePath

from tex_lightning.config import READ_FILES, Config
from tex_lightning.config.keys import Key, beyond, choice, plain
from tex_lightning.config.model import ModelConfig
from tex_lightning.config.tasks import EVERY_SENSE
from tex_lightning.errors import shorten
from tex_lightning.perturbations.table import (
    perturbations,
    read_severities,
    signal_perturbations,
)

AUTO = "auto"
PROFILED = (
    "haptic",
    "visual",
    "visual_tcnn",
    "visual_efficientnet",
    "visual_vgg_m",
    "tcnn",
)
NEED_CHECKPOINTS = ("evaluate", "enroll", "predict", "stream", "export")
READ_CHECKPOINTS = (*NEED_CHECKPOINTS, "profile", "record")
RECORDED = ("haptic", "sound", "image")
# Keys that the other tasks would pass over in silence, and the tasks that read them.
READ_BY = {
    "data.hold_out": ("fit", "crossval", "evaluate"),
    "data.per_class": ("fit", "crossval", "frontier", "enroll"),
    "data.skip_bad": ("fit", "crossval", "evaluate", "enroll", "stability", "frontier"),
    "data.test_where": ("fit", "evaluate", "stability"),
    "enroll.forget": ("enroll",),
    "enroll.only": ("enroll",),
    "frontier.max_latency_ms": ("frontier",),
    "frontier.min_accuracy": ("frontier",),
    "frontier.only": ("frontier",),
    "optimized_metric": ("fit", "crossval"),
    "predict.fast_decode": ("predict",),
    "predict.figure": ("predict",),
    "stability.severities": ("stability",),
    "stability.systems": ("stability",),
    "weights": ("fit", "crossval", "frontier"),
}
INSTEAD = {
    ("data.test_where", "crossval"): "test one condition after the other by a sweep of task=fit, "
    "as in -m 'data.test_where={speed: 50},{speed: 60}'"
}


def check_task(config: Config) -> Iterator[str]:
    """Complaints about the task and the keys that belong to one task."""
    data = config.data
    if config.task == "fit" and data.test_fold is None:
        yield "data.test_fold is null, but task=fit tests on a fold: give its number"
    several = (config.trainer.devices, config.trainer.num_nodes) != (1, 1)
    if several and config.task not in ("fit", "crossval"):
        yield (
            f"several devices are used by task=fit and task=crossval, not by task={config.task}: "
            "leave out trainer=ddp, trainer.devices and trainer.num_nodes"
        )
    if config.checkpoint is not None and config.task not in READ_CHECKPOINTS:
        yield (
            f"checkpoint is given, but task={config.task} does not read it: use "
            f"{', '.join(f'task={name}' for name in sorted(READ_CHECKPOINTS))} or "
            "model.fusion.haptic_checkpoint"
        )
    yield from _stream(config)
    if config.files and config.task not in READ_FILES:
        yield (
            f"{' and '.join(config.files)}: files are read by task=predict and task=profile, not "
            f"by task={config.task}"
        )
    if config.checkpoint is None and config.task in NEED_CHECKPOINTS:
        yield f"checkpoint is null, but task={config.task} needs one: give its file"
    if config.task == "record":
        yield from _record(config)
    yield from _figure(config)
    if config.task == "enroll" and data.val_fold is not None:
        yield "data.val_fold is set, but task=enroll chooses nothing: leave it null"
    yield from _unread(config)
    yield from _optimized_metric(config)
    yield from _frontier(config)
    if config.task == "profile" and config.checkpoint is None and config.model.baseline is not None:
        yield (
            f"task=profile measures networks, and model={config.model.name} is none: time it by "
            "task=frontier"
        )
    yield from _stability(config)
    starts = config.model.checkpoints
    if config.task == "crossval" and starts:
        yield (
            "unimodal checkpoints fit one fold only, so task=crossval cannot start from them: "
            f"leave {' and '.join(f'model.fusion.{name}_checkpoint' for name in starts)} null"
        )
    if config.task == "crossval" and data.val_fold is not None:
        yield (
            "data.val_fold is set, but task=crossval trains on all folds but the tested one: "
            "leave it null"
        )
    for name in config.crossval.profile:
        yield from choice("crossval.profile", name, PROFILED)
    baseline = config.model.baseline
    if (
        config.weights is not None
        and baseline is not None
        and "trunk" not in baseline
        and config.task != "frontier"  # whose family may have networks on photos
    ):
        yield f"weights belong to a trunk, which model={config.model.name} does not have"
    for name in starts:
        if config.weights_of(name) is not None:
            yield f"weights and model.fusion.{name}_checkpoint both fill the {name} trunk: give one"


def _record(config: Config) -> Iterator[str]:
    settings, label = config.record, config.record.label
    if settings.out is None:
        yield "record.out is null: name the folder of the data set, new or one that grows"
    if label is None:
        yield "record.label is null: name the class that is recorded"
    elif not _is_plain_name(label):
        yield f"record.label is {label!r}, which cannot be the name of a folder: take plain letters"
    if not config.files:
        yield "nothing is recorded: give haptic=SOURCE, sound=SOURCE or image=camera:0"
    for modality, given in config.files.items():
        if modality not in RECORDED:
            yield f"{modality} is not recorded: task=record takes {', '.join(RECORDED)}"
        elif isinstance(given, list | dict):
            yield f"{modality}={given} is several: task=record takes one source of each sense"
    if settings.least_seconds > settings.seconds:
        yield (
            f"record.least_seconds is {plain(settings.least_seconds)}: choose at most "
            f"record.seconds, {plain(settings.seconds)}"
        )
    if settings.contact and set(config.files) == {"image"}:
        yield "record.contact needs a signal: give haptic=SOURCE or sound=SOURCE"


def _is_plain_name(name: str) -> bool:
    """Whether a folder can be called so on any system."""
    forbidden = set('/\\:*?"<>|')
    return name.isprintable() and name == name.strip(" .") != "" and not forbidden & {*name}


def _stream(config: Config) -> Iterator[str]:
    if config.task != "stream":
        return
    if not config.files:
        yield "task=stream reads signals: give haptic=FILE, or haptic=- for a pipe"
    if list(config.files.values()).count("-") > 1:
        yield "only one signal can be standard input: give files for the others"


def _figure(config: Config) -> Iterator[str]:
    given = config.predict.figure
    if given is not None and PurePath(given).suffix.lower() != ".png":
        yield f"predict.figure={shorten(given)} must end in .png"


def _unread(config: Config) -> Iterator[str]:
    for key, tasks in READ_BY.items():
        given = attrgetter(key)(config)
        if given not in (None, []) and given is not False and config.task not in tasks:
            readers = " and ".join(f"task={task}" for task in tasks)
            instead = INSTEAD.get((key, config.task), "leave it out")
            yield f"{key} is read by {readers} alone, not by task={config.task}: {instead}"


def _optimized_metric(config: Config) -> Iterator[str]:
    metric = config.optimized_metric
    if metric == "val_loss" and config.data.val_fold is None:
        yield "optimized_metric=val_loss needs a fold to validate on: give data.val_fold"
    elif metric == "val_loss" and config.model.baseline is not None:
        yield (
            f"model={config.model.name} has no validation loss: choose optimized_metric=vote_error"
        )


def _frontier(config: Config) -> Iterator[str]:
    frontier = config.frontier
    listed = isinstance(frontier.senses, list)
    if listed and not frontier.senses:
        yield "frontier.senses names nothing: give senses, auto, or null"
    if frontier.only is not None and not frontier.only:
        yield "frontier.only names nothing: leave it null for all systems"
    for name in frontier.senses if listed else [frontier.senses]:
        allowed = config.model.known if listed else (EVERY_SENSE, None, "a list of senses")
        yield from choice("frontier.senses", name, allowed)
    if config.model.name == AUTO and config.task not in ("fit", "frontier"):
        yield f"model=auto trains one network, task={config.task} does not: use task=fit"
    if frontier.run is not None and config.model.name != AUTO:
        yield "frontier.run is read by model=auto alone: leave it out"
    if config.model.name == AUTO and frontier.run is None and config.data.test_where is not None:
        yield "model=auto would choose on what data.test_where tests: give frontier.run"
    if config.task == "frontier" and config.data.val_fold is not None:
        yield "data.val_fold is set, but task=frontier leaves a fold of its own out: leave it null"
    here = config.task == "frontier" or (config.model.name == AUTO and frontier.run is None)
    if here and config.data.folds < 3:
        yield f"data.folds is {config.data.folds}: two are left out of training, choose 3 or more"
    if config.model.name == AUTO and frontier.run is None and config.data.inverted:
        yield (
            "data.inverted trains on one fold alone, which leaves model=auto none to choose on: "
            "give frontier.run"
        )


def check_decision(config: Config) -> Iterator[str]:
    """Complaints about ``decision``."""
    decision = config.decision
    for key in ("pairs", "rule", "seed"):
        if getattr(decision, key) is None and config.task not in (*NEED_CHECKPOINTS, "record"):
            yield f"decision.{key} is null, but task={config.task} has no checkpoint with one"
    if decision.name == "sequential" and config.model.baseline is not None:
        yield (
            "decision=sequential needs a network, and a baseline looks at the whole recording at "
            "once: use decision=max_vote"
        )
    if decision.name == "sequential" and config.task in (
        "profile", "record", "stability", "stream",
    ):  # fmt: skip
        yield f"decision=sequential is not read by task={config.task}: leave it out"
    if decision.unknown and decision.name == "sequential":
        yield (
            "decision.unknown looks at all of a recording, and decision=sequential does not: use "
            "decision=max_vote"
        )
    if decision.unknown and config.model.baseline is not None:
        yield (
            f"decision.unknown needs features of a network, and model={config.model.name} is none: "
            "use decision.reject_below"
        )
    if decision.unknown and config.task == "fit" and config.data.val_fold is None:
        yield from _unvalidated(config.model)


def _unvalidated(model: ModelConfig) -> Iterator[str]:
    if model.baseline is None and any(model.fit_values(kind)["epochs"] for kind in model.trained):
        yield (
            "decision.unknown needs known recordings that the network is not trained on: give "
            "data.val_fold=1"
        )


def _stability(config: Config) -> Iterator[str]:
    stability = config.stability
    if config.task == "stability" and not stability.systems:
        yield "stability.systems names nothing: give run folders or checkpoints, e.g. [RUN]"
    own = [name for path in stability.severities for name in read_severities(path)]
    generic = tuple(signal_perturbations(""))  # of senses that the systems may have
    for name in stability.only or []:
        if not name.endswith(generic):
            yield from choice("stability.only", name, (*perturbations(), *own))
    if stability.only is not None and not stability.only:
        yield "stability.only names nothing: leave it null for all perturbations"
    known = Key("fold", least=0, most=config.data.folds - 1)
    yield from beyond("stability.folds", stability.folds, known)
