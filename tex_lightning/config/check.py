"""Checks of a composed configuration: values against annotations, and keys that need each other.

Types, ranges and choices of single keys stand in the annotations of sections and classes. Beside
them only that is checked which would be passed over in silence or fail late; a class reports itself
what else it rejects when it is made. All complaints are made at once, before any work.
"""

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from operator import attrgetter
from typing import Any

from omegaconf import DictConfig

from tex_lightning.config import READ_FILES, Config, ModelConfig, trunk_name
from tex_lightning.config.composition import read_config
from tex_lightning.config.keys import choice
from tex_lightning.config.model import CHECKPOINT
from tex_lightning.config.nodes import node_complaints, shared_complaints
from tex_lightning.config.signatures import TARGET, misfits
from tex_lightning.config.tasks import TRAINING
from tex_lightning.errors import UserError, shorten

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
NOT_SEQUENTIAL = ("profile", "stability", "stream")
Rule = tuple[bool, str]  # whether something is wrong, and the complaint


def checked_config(composed: DictConfig) -> Config:
    """Return the typed form of a composed configuration, checked.

    Raises:
        UserError: If a key or value cannot be used.
    """
    config = read_config(composed)
    check_config(config)
    return config


def check_config(config: Config) -> None:
    """Reject invalid values, naming all of them in one sentence.

    Raises:
        UserError: If there are any.
    """
    rules = (_model_rules, _data_rules, _decision_rules, _task_rules, _record_rules)
    complaints = [complaint for rule in rules for wrong, complaint in rule(config) if wrong]
    complaints += [*_values(config), *_parts(config), *_unknown_names(config)]
    _refuse([*dict.fromkeys(complaints)])


def _values(section: Any, prefix: str = "") -> Iterator[str]:  # noqa: ANN401
    """Yield a complaint for each value of the sections that their fields do not take."""
    values = {entry.name: getattr(section, entry.name) for entry in fields(section)}
    yield from misfits(prefix, type(section), values)
    for name, value in values.items():
        if is_dataclass(value):
            yield from _values(value, f"{prefix}.{name}".removeprefix("."))


def _parts(config: Config) -> Iterator[str]:
    """Yield a complaint for each value that a class which the configuration names does not take."""
    model = config.model
    yield from node_complaints("data.reader", config.data.reader)
    yield from node_complaints("model.baseline", model.baseline)
    for name in model.known:
        section, where = model.sense(name), f"model.{name}"
        yield from shared_complaints(where, section.node, *section.classes)
        if name in model.senses:
            given = {key: value for key, value in section.decode.items() if value is not None}
            yield from node_complaints(f"{where}.decode", {TARGET: section.decoder, **given})
            for part, node in section.node.items():
                yield from node_complaints(f"{where}.{part}", node)


def _refuse(complaints: list[str]) -> None:
    if complaints:
        raise UserError("; ".join(complaints) + ".")


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
            value is not None and value not in data.reader.values(),
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
        value = attrgetter(key)(config)
        yield (
            value not in (None, []) and value is not False and task not in tasks,
            f"{key} is read by {', '.join(f'task={name}' for name in tasks)} alone, not by "
            f"task={shorten(task)}: leave it out",
        )
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


def _unknown_names(config: Config) -> Iterator[str]:
    """Yield a sentence for each name that no sense and no perturbation has."""
    model, senses = config.model, config.frontier.senses
    checkpoints = [f"{name}{CHECKPOINT}" for name in model.known]
    if isinstance(config.weights, dict):
        yield from _unknown_trunks(config.weights, model)
    for key in vars(model.fusion):
        if key.endswith(CHECKPOINT):
            yield from choice("a key of model.fusion", key, checkpoints)
    for sense in senses or ():
        yield from choice("frontier.senses", sense, model.known)
    for name in model.known:
        node = model.sense(name)
        for perturbation in node.fit.perturb:
            # loads OpenCV, which predictions do without
            from tex_lightning.perturbations.table import trainable

            known = trainable(node.modality)
            yield from choice(f"model.{name}.fit.perturb", perturbation, known)


def _unknown_trunks(sources: dict[str, str], model: ModelConfig) -> Iterator[str]:
    from tex_lightning.networks.trunks import TRUNKS  # takes PyTorch

    known = [*TRUNKS, trunk_name(model, "visual"), *(set(model.known) - {"visual"})]
    for name in sources:
        yield from choice("a trunk in weights", name, known)


def check_shares(config: Config, processes: int) -> None:
    """Reject batches that ``processes`` processes cannot share evenly.

    Raises:
        UserError: Naming the batch sizes.
    """
    sizes = {kind: getattr(config.model, kind).fit.batch_size for kind in config.model.trained}
    complaints = [
        f"model.{kind}.fit.batch_size is {size}, but {processes} processes share every batch: "
        f"choose a multiple of {processes}"
        for kind, size in sizes.items()
        if size % processes
    ]
    _refuse(complaints)
