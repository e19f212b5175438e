"""Keys of the configuration that need each other, or that a task would pass over in silence.

A rule says whether something is wrong, and the complaint.
"""

import re
from collections.abc import Callable, Iterator, Sequence
from operator import attrgetter

from tex_lightning.config import READ_FILES, Config
from tex_lightning.config.signatures import TARGET
from tex_lightning.config.tasks import TRAINING
from tex_lightning.errors import shorten

RECORDED = ("haptic", "sound", "image")  # modalities of task=record
HAVE_CHECKPOINTS = ("evaluate", "enroll", "adapt", "predict", "stream", "export")
# Keys without which a task can do nothing.
NEEDED = {
    "checkpoint": HAVE_CHECKPOINTS,
    "record.out": ("record",),
    "record.label": ("record",),
    "stability.systems": ("stability",),
}
# Keys that the other tasks would pass over in silence, and the tasks that read them.
READ_BY = {
    "checkpoint": (*HAVE_CHECKPOINTS, "profile"),
    **dict.fromkeys(("haptic", "image", "sound"), READ_FILES),
    "adapt": ("predict",),
    "weights": (*TRAINING, "frontier"),
    "data.hold_out": ("fit", "crossval", "evaluate"),
    "data.per_class": ("fit", "crossval", "frontier", "enroll"),
    "data.skip_bad": ("fit", "crossval", "evaluate", "enroll", "adapt", "stability", "frontier"),
    "data.val_fold": ("fit", "evaluate", "export", "stability"),
    "data.test_where": ("fit", "evaluate", "adapt", "stability"),
}
OF_TASKS = {  # in a file they may stand for several tasks, and are no mistake then
    "crossval.only": ("crossval", "frontier"),
    "crossval.refit": ("crossval",),
    **dict.fromkeys(("frontier.only", "frontier.senses"), ("frontier",)),
    **{f"stability.{name}": ("stability",) for name in ("systems", "only", "severities")},
    **dict.fromkeys(("record.label", "record.out"), ("record",)),
    "export.out": ("export",),
    "stream.window": ("stream", "predict"),  # a predictor in Python makes streams
}
NOT_SEQUENTIAL = ("profile", "stability", "stream")
Rule = tuple[bool, str]


def _model_rules(config: Config) -> Iterator[Rule]:
    model = config.model
    yield (
        not model.senses or len(set(model.senses)) < len(model.senses),
        f"model.senses is {shorten(model.senses)}: name one sense or several, each once",
    )
    yield (
        model.baseline is not None and len(model.senses) > 1,
        f"model={model.name} looks at one sense: give one in model.senses",
    )
    yield (
        not isinstance(config.weights, str | dict | None),
        f"weights is {shorten(config.weights)}: give one source, or {{TRUNK: SOURCE}} for several",
    )
    devices = config.trainer.devices
    yield (
        devices != "auto" and not isinstance(devices, int),
        f"trainer.devices is {shorten(repr(devices))}: give a number or auto",
    )


def _data_rules(config: Config) -> Iterator[Rule]:
    data = config.data
    for key in ("root", "manifest", "group_by"):
        value = getattr(data, key)
        yield (
            value is not None and not _holds(data.reader, value),
            f"data.{key} is not read by data={data.name}: leave it out, or give data=NAME",
        )
    for key in ("test_fold", "val_fold"):
        fold = getattr(data, key)
        yield (
            fold is not None and data.folds > 1 and not 0 <= fold < data.folds,
            f"data.{key} is {shorten(fold)}: choose from 0 to {data.folds - 1}",
        )
    yield (
        data.val_fold is not None and data.val_fold == data.test_fold,
        f"data.val_fold and data.test_fold are both {data.val_fold}: choose different folds",
    )
    yield (
        data.test_where is not None and not (data.test_where and type(data.test_where) is dict),
        f"data.test_where is {shorten(data.test_where)}: give names and values of conditions, as "
        "in {speed: 60} or {speed: [50, 60], light: lamp}",
    )


def _holds(given: object, value: str) -> bool:
    """Return whether what a reader is given is, or has inside it, a text as a whole word."""
    if isinstance(given, dict):
        return any(_holds(item, value) for key, item in given.items() if key != TARGET)
    if isinstance(given, list):
        return any(_holds(item, value) for item in given)
    whole = rf"(?<![^\W_]){re.escape(value)}(?![^\W_])"
    return isinstance(given, str) and re.search(whole, given) is not None


def _decision_rules(config: Config) -> Iterator[Rule]:
    decision, model, task = config.decision, config.model, config.task
    for key in ("pairs", "rule", "seed"):
        yield (
            getattr(decision, key) is None and task not in HAVE_CHECKPOINTS,
            f"decision.{key} is null, but task={task} has no checkpoint with one",
        )
    sequential, unknown = decision.name == "sequential", bool(decision.unknown)
    yield (
        sequential and (model.baseline is not None or task in NOT_SEQUENTIAL),
        "decision=sequential looks at parts of a recording, which goes with neither a baseline nor "
        f"{', '.join(f'task={name}' for name in NOT_SEQUENTIAL)}: leave it out",
    )
    yield (
        unknown and model.baseline is not None,
        f"decision.unknown needs features of a network, and model={model.name} is none: "
        "leave it out",
    )
    trained = model.trained if model.baseline is None else ()
    steps = any(model.fit_values(kind)["epochs"] for kind in trained)
    yield (
        unknown and task == "fit" and config.data.val_fold is None and steps,
        "decision.unknown needs known recordings that the network is not trained on: give "
        "data.val_fold=1",
    )


def _unread(config: Config, key: str, tasks: Sequence[str]) -> Rule:
    value, task = attrgetter(key)(config), config.task
    return (
        value not in (None, []) and value is not False and task not in tasks,
        f"{key} is read by {', '.join(f'task={name}' for name in tasks)} alone, not by "
        f"task={shorten(task)}: leave it out",
    )


def unread_where_set(config: Config, sets: Callable[[str], bool]) -> Iterator[str]:
    """Yield a complaint for each key that the command sets, and that only another task reads."""
    for key, tasks in OF_TASKS.items():
        wrong, complaint = _unread(config, key, tasks)
        if wrong and sets(key):
            yield complaint


def _task_rules(config: Config) -> Iterator[Rule]:
    task, model, baseline = config.task, config.model, config.model.baseline
    yield (
        (config.trainer.devices, config.trainer.num_nodes) != (1, 1)
        and config.task not in TRAINING,
        "several devices are used by task=fit and task=crossval, not by "
        f"task={config.task}: leave out trainer.devices and trainer.num_nodes",
    )
    for key, tasks in NEEDED.items():
        yield (
            task in tasks and attrgetter(key)(config) in (None, []),
            f"{key} is null, but task={task} needs one: give it",
        )
    for key, tasks in READ_BY.items():
        yield _unread(config, key, tasks)
    yield config.frontier.senses == [], "frontier.senses names nothing: leave it null"
    yield (
        task == "profile" and config.checkpoint is None and baseline is not None,
        f"task=profile measures networks, and model={model.name} is none: time it by task=frontier",
    )
    yield (
        task == "crossval" and bool(model.checkpoints),
        "unimodal checkpoints fit one fold only, so task=crossval cannot start from them: leave "
        "model.fusion.*_checkpoint null",
    )
    yield (
        task in ("record", "stream") and not config.files,
        f"task={task} has nothing to read: give haptic=FILE, or haptic=- for a pipe",
    )
    yield (
        list(config.files.values()).count("-") > 1,
        "only one signal can be standard input: give files for the others",
    )


def _record_rules(config: Config) -> Iterator[Rule]:
    record = config.record
    if config.task != "record":
        return
    for modality, source in config.files.items():
        yield (
            modality not in RECORDED or isinstance(source, list | dict),
            f"{modality}={shorten(source)} is not recorded: task=record takes one source of "
            f"each of {', '.join(RECORDED)}",
        )
    yield (
        record.label is not None and not _is_plain_name(record.label),
        f"record.label is {record.label!r}, which cannot be the name of a folder: take plain "
        "letters",
    )


def _is_plain_name(name: str) -> bool:
    """Return whether a folder can be called so on any system."""
    forbidden = set('/\\:*?"<>|')
    return name.isprintable() and name == name.strip(" .") != "" and not forbidden & {*name}


RULES: tuple[Callable[[Config], Iterator[Rule]], ...] = (
    _model_rules, _data_rules, _decision_rules, _task_rules, _record_rules,
)  # fmt: skip
