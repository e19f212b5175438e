"""Checks of a configuration beyond types: ranges, choices, and keys that need each other.

Ranges and choices of single keys stand in the schema. Beside them only that is checked which would
be passed over in silence or fail late; what a class refuses when it is made, it says itself. All
complaints are made at once, before any work.
"""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf

from tex_lightning.config import READ_FILES, READS, Config, ModelConfig, flatten
from tex_lightning.config.instantiation import TARGET, find_callable, find_class
from tex_lightning.config.keys import beyond, choice, nearest, walk
from tex_lightning.config.mistakes import unknown_key
from tex_lightning.config.model import CHECKPOINT, FUSION, SignalFitConfig
from tex_lightning.errors import UserError, shorten

RECORDED = ("haptic", "sound", "image")  # modalities of task=record
HAVE_CHECKPOINTS = ("evaluate", "enroll", "predict", "stream", "export")
# Keys without which a task can do nothing.
NEEDED = {
    "checkpoint": HAVE_CHECKPOINTS,
    "data.test_fold": ("fit",),
    "record.out": ("record",),
    "record.label": ("record",),
    "stability.systems": ("stability",),
}
# Keys that the other tasks would pass over in silence, and the tasks that read them.
READ_BY = {
    "data.hold_out": ("fit", "crossval", "evaluate"),
    "data.per_class": ("fit", "crossval", "frontier", "enroll"),
    "data.skip_bad": ("fit", "crossval", "evaluate", "enroll", "stability", "frontier"),
    "data.test_where": ("fit", "evaluate", "stability"),
    **{
        key: tuple(task for task in READS if key in READS[task])
        for key in ("checkpoint", "haptic", "image", "sound", "optimized_metric", "weights")
    },
}
NOT_VALIDATED = ("crossval", "enroll", "frontier")  # tasks that choose nothing on data.val_fold
NOT_SEQUENTIAL = ("profile", "stability", "stream")
NOT_EMPTY = ("frontier.only", "frontier.senses", "stability.only")
SET_HERE = (  # flags of the Trainer
    "callbacks", "default_root_dir", "fast_dev_run", "logger", "max_epochs", "plugins",
    "use_distributed_sampler",
)  # fmt: skip
Rule = tuple[bool, str]  # whether something is wrong, and the complaint


def check_config(config: Config) -> None:
    """Refuse invalid values, naming all of them in one sentence.

    Raises:
        UserError: If there are any.
    """
    rules = (_model_rules, _data_rules, _decision_rules, _task_rules, _record_rules)
    complaints = [complaint for rule in rules for wrong, complaint in rule(config) if wrong]
    for name, key in walk(Config):
        complaints += beyond(name, attrgetter(name)(config), key)
    _refuse([*complaints, *_unread(config.model), *_unknown_names(config)])


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
    for kind in model.trained if model.baseline is None else ():
        yield (
            not model.fit_values(kind)["epochs"] and not _is_fitted_at_once(model, kind),
            f"model.{kind}.fit.epochs is 0: choose 1 or more",
        )
    for name in config.trainer.flags:
        yield name in SET_HERE, f"trainer.{name} is set by this package: leave it out"


def _is_fitted_at_once(model: ModelConfig, kind: str) -> bool:
    """Whether a network is anything without steps of training."""
    if kind == FUSION:
        return model.fusion.head_start == "scores"
    network = find_class(f"model.{kind}.network", model.sense(kind).network)
    return hasattr(network, "fit") or (kind == "visual" and not model.visual.head)


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
            fold is not None and not 0 <= fold < data.folds,
            f"data.{key} is {shorten(fold)}: choose from 0 to {data.folds - 1}",
        )
    yield (
        data.val_fold is not None and data.val_fold == data.test_fold,
        f"data.val_fold and data.test_fold are both {data.val_fold}: choose different folds",
    )
    yield (
        data.val_fold is not None and config.task in NOT_VALIDATED,
        f"data.val_fold is set, but task={config.task} validates nothing: leave it null",
    )
    yield (
        data.test_where is not None and not _are_conditions(data.test_where),
        f"data.test_where is {shorten(data.test_where)}: give names and values of conditions, as "
        "in {speed: 60} or {speed: [50, 60], light: lamp}",
    )
    yield (
        data.test_where is not None and data.inverted,
        "data.inverted tests all folds but one and data.test_where some conditions: give one",
    )


def _are_conditions(where: object) -> bool:
    if not isinstance(where, dict) or not where:
        return False
    lists = [value if isinstance(value, list) else [value] for value in where.values()]
    plain = (not isinstance(value, dict | list | None) for values in lists for value in values)
    return all(lists) and all(plain)


def _decision_rules(config: Config) -> Iterator[Rule]:
    decision, model, task = config.decision, config.model, config.task
    for key in ("pairs", "rule", "seed"):
        yield (
            getattr(decision, key) is None and task not in HAVE_CHECKPOINTS,
            f"decision.{key} is null, but task={task} has no checkpoint with one",
        )
    sequential, unknown = decision.name == "sequential", bool(decision.unknown)
    yield (
        sequential and (model.baseline is not None or unknown or task in NOT_SEQUENTIAL),
        "decision=sequential looks at parts of a recording, which goes with neither a baseline, "
        f"decision.unknown nor {', '.join(f'task={name}' for name in NOT_SEQUENTIAL)}: leave it "
        "out",
    )
    yield (
        unknown and model.baseline is not None,
        f"decision.unknown needs features of a network, and model={model.name} is none: use "
        "decision.reject_below",
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
        and config.task not in ("fit", "crossval"),
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
            f"task={task}: leave it out",
        )
    for key in NOT_EMPTY:
        yield attrgetter(key)(config) == [], f"{key} names nothing: leave it null"
    yield (
        config.optimized_metric == "val_loss"
        and (config.data.val_fold is None or baseline is not None),
        "optimized_metric=val_loss needs a network and data.val_fold: give both, or choose "
        "optimized_metric=vote_error",
    )
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
        task == "frontier" and config.data.folds < 3,
        f"data.folds is {config.data.folds}: two are left out of training, choose 3 or more",
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
    yield (
        record.least_seconds > record.seconds,
        "record.least_seconds exceeds record.seconds: choose less",
    )


def _is_plain_name(name: str) -> bool:
    """Whether a folder can be called so on any system."""
    forbidden = set('/\\:*?"<>|')
    return name.isprintable() and name == name.strip(" .") != "" and not forbidden & {*name}


def _unknown_names(config: Config) -> Iterator[str]:
    """Complain of names that no sense, perturbation or system has."""
    model, senses, stability = config.model, config.frontier.senses, config.stability
    checkpoints = [f"{name}{CHECKPOINT}" for name in model.known]
    for key in vars(model.fusion):
        if key.endswith(CHECKPOINT):
            yield from choice("a key of model.fusion", key, checkpoints)
    for sense in senses or ():
        yield from choice("frontier.senses", sense, model.known)
    perturbed = [name for name in model.known if model.sense(name).fit.perturb]
    if not perturbed and stability.only is None and not stability.severities:
        return
    from tex_lightning.perturbations import table  # loads OpenCV, which predictions do without

    for name in perturbed:
        node = model.sense(name)
        medium = "signal" if isinstance(node.fit, SignalFitConfig) else "photo"
        for perturbation in node.fit.perturb:
            known = table.trainable(node.modality, medium)
            yield from choice(f"model.{name}.fit.perturb", perturbation, known)
    extra = [name for path in stability.severities for name in table.read_severities(path)]
    generic = tuple(table.signal_perturbations(""))  # of senses that the systems may have
    for name in stability.only or []:
        if not name.endswith(generic):
            yield from choice("stability.only", name, (*table.perturbations(), *extra))


def _unread(model: ModelConfig) -> Iterator[str]:
    """Complain of keys of the senses that no class reads and that resemble one which is read."""
    for name in model.senses if model.baseline is None else ():
        where, sense = f"model.{name}", model.sense(name)
        known = {key.name for key in fields(sense)}
        keys: dict[str, set[str]] = {}
        for part, node in sense.node.items():
            if isinstance(node, Mapping) and TARGET in node:
                taken = {*inspect.signature(find_callable(f"{where}.{part}", node)).parameters}
                keys |= {f"{where}.{part}.{key}": taken for key in node}
                known |= taken - {*node}
        keys |= {f"{where}.{key}": known for key in sense.node}
        if decoder := _decoder_keys(find_class(where, sense.node)):
            keys |= {f"{where}.decode.{key}": known | decoder for key in sense.decode}
        for key, taken in keys.items():
            section, _, leaf = key.rpartition(".")
            if leaf in taken or leaf.startswith("_"):
                continue
            if near := nearest(leaf, taken, f"{section}."):
                yield f"{shorten(key)} is read by no class{near}: correct it"


def _decoder_keys(cls: type[Any]) -> set[str]:
    """Return the settings of the decoder of a sense; none if a user's class does not say."""
    decoder = getattr(getattr(cls, "make_decoder", None), "__annotations__", {}).get("return")
    return {key.name for key in fields(decoder)} if is_dataclass(decoder) else set()


def check_missing(composed: DictConfig) -> None:
    """Refuse a configuration with open ``???`` values, naming all of them."""
    missing = missing_keys(composed)
    if missing:
        example = " ".join(f"{key}=VALUE" for key in missing)
        raise UserError(f"No value for {', '.join(missing)}; add {example} to the command.")


def missing_keys(composed: DictConfig) -> list[str]:
    """Return dotted names of open ``???`` values, without those of what refers to them."""
    values: Any = OmegaConf.to_container(composed, resolve=False)
    return sorted(key for key, value in flatten(values).items() if value == MISSING)


def check_known(composed: DictConfig) -> None:
    """Refuse keys that were added with ``+`` and that nothing would read."""
    for key in _unknown(composed, OmegaConf.structured(Config), ""):
        raise unknown_key(key, composed)


def _unknown(node: DictConfig, known: DictConfig, prefix: str) -> Iterator[str]:
    for key in map(str, node):
        if key not in known.keys():  # noqa: SIM118  (`in known` is false for open values)
            if not _may_be_own(node, prefix, key):
                yield f"{prefix}{key}"
        # classes check the keys of other sections themselves
        elif is_dataclass(OmegaConf.get_type(known, key)) and not OmegaConf.is_missing(node, key):
            yield from _unknown(node[key], known[key], f"{prefix}{key}.")


def _may_be_own(node: DictConfig, prefix: str, key: str) -> bool:
    """Whether a key is a flag of Lightning's, or of a sense of the user's own."""
    if prefix == "model.":
        return OmegaConf.is_dict(node[key]) and TARGET in node[key]
    if prefix == "model.fusion.":
        return key.endswith(CHECKPOINT)
    return prefix == "trainer." or (not prefix and node.task in READ_FILES)


def check_shares(config: Config, processes: int) -> None:
    """Refuse batches that ``processes`` processes cannot share evenly.

    Raises:
        UserError: Naming the batch sizes.
    """
    complaints: list[str] = []
    for kind in config.model.trained if processes > 1 else ():
        section = getattr(config.model, kind)
        size = section.fit.batch_size
        # the statistics of one sample at one position are no statistics
        least = processes * (2 if getattr(section, "norm", None) == "batch" else 1)
        if size % processes or size < least:
            complaints.append(
                f"model.{kind}.fit.batch_size is {size}, but {processes} processes share every "
                f"batch: choose a multiple of {processes}, {least} or more"
            )
    _refuse(complaints)
