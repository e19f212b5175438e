"""Checks of a configuration beyond types: ranges, choices, and keys that need each other.

Ranges and choices of single keys stand in the schema. Beside them only that is checked which would
be passed over in silence or fail late; what a class refuses when it is made, it says itself. All
complaints are made at once, before any work.
"""

import inspect
from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from operator import attrgetter
from pathlib import PurePath
from typing import Any

from omegaconf import MISSING, DictConfig, OmegaConf

from tex_lightning.config import READ_FILES, Config, ModelConfig, flatten
from tex_lightning.config.instantiation import TARGET, find_callable, find_class
from tex_lightning.config.keys import beyond, choice, nearest, walk
from tex_lightning.config.mistakes import unknown_key
from tex_lightning.config.model import CustomPhotoConfig, CustomSignalConfig, SignalFitConfig
from tex_lightning.config.tasks import EVERY_SENSE
from tex_lightning.errors import UserError, shorten

CHECKPOINT = "_checkpoint"
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
    "checkpoint": (*HAVE_CHECKPOINTS, "profile", "record"),
    "haptic": READ_FILES,
    "image": READ_FILES,
    "sound": READ_FILES,
    "data.hold_out": ("fit", "crossval", "evaluate"),
    "data.per_class": ("fit", "crossval", "frontier", "enroll"),
    "data.skip_bad": ("fit", "crossval", "evaluate", "enroll", "stability", "frontier"),
    "data.test_where": ("fit", "evaluate", "stability"),
    "enroll.forget": ("enroll",),
    "enroll.only": ("enroll",),
    "frontier.only": ("frontier",),
    "optimized_metric": ("fit", "crossval"),
    "predict.figure": ("predict",),
    "stability.severities": ("stability",),
    "stability.systems": ("stability",),
    "weights": ("fit", "crossval", "frontier"),
}
NOT_VALIDATED = ("crossval", "enroll", "frontier")  # tasks that choose nothing on data.val_fold
NOT_SEQUENTIAL = ("profile", "record", "stability", "stream")
NOT_EMPTY = ("frontier.only", "frontier.senses", "stability.only")
SET_HERE = (  # flags of the Trainer
    "callbacks", "default_root_dir", "fast_dev_run", "logger", "max_epochs", "plugins",
    "use_distributed_sampler",
)  # fmt: skip


def check_config(config: Config) -> None:
    """Refuse invalid values, naming all of them in one sentence.

    Raises:
        UserError: If there are any.
    """
    rules = (_model_rules, _data_rules, _decision_rules, _task_rules)
    said = [complaint for rule in rules for wrong, complaint in rule(config) if wrong]
    _refuse([*check_ranges(config), *said, *_unread(config), *_names(config)])


def _refuse(complaints: list[str]) -> None:
    if complaints:
        raise UserError("; ".join(complaints) + ".")


def check_ranges(config: Config) -> Iterator[str]:
    """Complain of values outside the range or the choices that the schema gives their key."""
    for name, key in walk(Config):
        yield from beyond(name, attrgetter(name)(config), key)


Rule = tuple[bool, str]  # whether something is wrong, and what to say of it


def _model_rules(config: Config) -> Iterator[Rule]:
    model = config.model
    for key, node in (
        ("model.baseline", model.baseline),
        ("model.visual.fit.augmentation", model.visual.fit.augmentation),
    ):
        yield (
            not isinstance(node, dict | None),
            f"{key} is {shorten(node)}: give a class and arguments, {{_target_: a.b.Name}}",
        )
    yield (
        not model.senses or len(set(model.senses)) < len(model.senses),
        f"model.senses is {shorten(model.senses)}: name one sense or several, each once",
    )
    yield (
        model.baseline is not None and len(model.senses) > 1,
        f"model={model.name} looks at one sense: give one in model.senses",
    )
    yield (
        len(model.visual.head) not in (0, 2),
        f"model.visual.head is {shorten(model.visual.head)}: give channels of FC1 and FC2, or []",
    )
    for kind in model.trained if model.baseline is None else ():
        yield (
            not model.fit_values(kind)["epochs"] and not _fitted_at_once(model, kind),
            f"model.{kind}.fit.epochs is 0: choose 1 or more",
        )
    for name in config.trainer.flags:
        yield name in SET_HERE, f"trainer.{name} is set by this package: leave it out"


def _fitted_at_once(model: ModelConfig, kind: str) -> bool:
    """Whether a network is anything without steps of training."""
    if kind == "fusion":
        return model.fusion.head_start == "scores"
    network = find_class(f"model.{kind}.network", model.sense(kind).network)
    return hasattr(network, "fit") or (kind == "visual" and not model.visual.head)


def _data_rules(config: Config) -> Iterator[Rule]:
    data = config.data
    for key in ("root", "manifest"):
        given = getattr(data, key)
        yield (
            given is not None and given not in data.reader.values(),
            f"data.{key} is given, but data={data.name} does not read it: use data=folder",
        )
    for name in ("test_fold", "val_fold"):
        fold = getattr(data, name)
        yield (
            fold is not None and not 0 <= fold < data.folds,
            f"data.{name} is {shorten(fold)}: choose from 0 to {data.folds - 1}",
        )
    yield (
        data.resize is not None and data.half_scale,
        "data.half_scale and data.resize both decide the size of photos: turn one off",
    )
    yield (
        data.group_by is not None and "group_by" not in data.reader,
        f"data.group_by is not read by data={data.name}: leave it out",
    )
    yield (
        data.val_fold is not None and data.val_fold == data.test_fold,
        f"data.val_fold and data.test_fold are both {data.val_fold}: choose different folds",
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
    given = list(where.values()) if isinstance(where, dict) else []
    values = [item for each in given for item in (each if isinstance(each, list) else [each])]
    return len(values) >= len(given) > 0 and not any(
        isinstance(item, dict | list | None) for item in values
    )


def _decision_rules(config: Config) -> Iterator[Rule]:
    decision, model, task = config.decision, config.model, config.task
    for key in ("pairs", "rule", "seed"):
        yield (
            getattr(decision, key) is None and task not in (*HAVE_CHECKPOINTS, "record"),
            f"decision.{key} is null, but task={task} has no checkpoint with one",
        )
    sequential, unknown = decision.name == "sequential", bool(decision.unknown)
    yield (
        sequential and (model.baseline is not None or unknown),
        "decision=sequential needs a network and no decision.unknown, which look at parts of a "
        "recording and at all of it: use decision=max_vote",
    )
    yield (
        sequential and task in NOT_SEQUENTIAL,
        f"decision=sequential is not read by task={task}: leave it out",
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
    task, data, model, record = config.task, config.data, config.model, config.record
    for key, tasks in NEEDED.items():
        yield (
            task in tasks and attrgetter(key)(config) in (None, []),
            f"{key} is null, but task={task} needs one: give it",
        )
    for key, tasks in READ_BY.items():
        given = attrgetter(key)(config)
        yield (
            given not in (None, []) and given is not False and task not in tasks,
            f"{key} is read by {', '.join(f'task={each}' for each in tasks)} alone, not by "
            f"task={task}: leave it out",
        )
    for key in NOT_EMPTY:
        yield attrgetter(key)(config) == [], f"{key} names nothing: leave it null"
    yield (
        data.val_fold is not None and task in NOT_VALIDATED,
        f"data.val_fold is set, but task={task} validates nothing: leave it null",
    )
    yield (
        config.optimized_metric == "val_loss"
        and (data.val_fold is None or model.baseline is not None),
        "optimized_metric=val_loss needs a network and data.val_fold: give both, or choose "
        "optimized_metric=vote_error",
    )
    yield (
        task == "profile" and config.checkpoint is None and model.baseline is not None,
        f"task=profile measures networks, and model={model.name} is none: time it by task=frontier",
    )
    yield (
        task == "crossval" and bool(model.checkpoints),
        "unimodal checkpoints fit one fold only, so task=crossval cannot start from them: leave "
        "model.fusion.*_checkpoint null",
    )
    yield (
        config.weights is not None
        and model.baseline is not None
        and "trunk" not in model.baseline
        and task != "frontier",  # whose family may have networks on photos
        f"weights belong to a trunk, which model={model.name} does not have",
    )
    yield (
        task == "frontier" and config.data.folds < 3,
        f"data.folds is {config.data.folds}: two are left out of training, choose 3 or more",
    )
    for name in model.checkpoints:
        yield (
            config.weights_of(name) is not None,
            f"weights and model.fusion.{name}_checkpoint both fill the {name} trunk: give one",
        )
    yield (
        config.predict.figure is not None
        and PurePath(config.predict.figure).suffix.lower() != ".png",
        f"predict.figure={shorten(config.predict.figure)} must end in .png",
    )
    yield (
        task in ("record", "stream") and not config.files,
        f"task={task} has nothing to read: give haptic=FILE, or haptic=- for a pipe",
    )
    yield (
        list(config.files.values()).count("-") > 1,
        "only one signal can be standard input: give files for the others",
    )
    if task == "record":
        for modality, given in config.files.items():
            yield (
                modality not in RECORDED or isinstance(given, list | dict),
                f"{modality}={shorten(given)} is not recorded: task=record takes one source of "
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
        yield (
            record.contact and set(config.files) == {"image"},
            "record.contact needs a signal: give haptic=SOURCE or sound=SOURCE",
        )


def _is_plain_name(name: str) -> bool:
    """Whether a folder can be called so on any system."""
    forbidden = set('/\\:*?"<>|')
    return name.isprintable() and name == name.strip(" .") != "" and not forbidden & {*name}


def _names(config: Config) -> Iterator[str]:
    """Complain of names that no sense, perturbation or system has."""
    model, senses = config.model, config.frontier.senses
    for key in vars(model.fusion):
        sense = key.removesuffix(CHECKPOINT)
        if sense != key and sense not in model.known:
            near = nearest(key, [f"{name}{CHECKPOINT}" for name in model.known], "model.fusion.")
            yield f"model.fusion.{key} is of no sense{near}: name one of {', '.join(model.known)}"
    allowed = model.known if isinstance(senses, list) else (EVERY_SENSE, None)
    for given in senses if isinstance(senses, list) else [senses]:
        yield from choice("frontier.senses", given, allowed)
    used = {name: model.sense(name) for name in model.known if model.sense(name).fit.perturb}
    if not used and config.stability.only is None and not config.stability.severities:
        return
    from tex_lightning.perturbations import table  # loads OpenCV, which predictions do without

    for name, perturbed in used.items():
        medium = "signal" if isinstance(perturbed.fit, SignalFitConfig) else "photo"
        for perturbation in perturbed.fit.perturb:
            known = table.trainable(perturbed.modality, medium)
            yield from choice(f"model.{name}.fit.perturb", perturbation, known)
    own = [name for path in config.stability.severities for name in table.read_severities(path)]
    generic = tuple(table.signal_perturbations(""))  # of senses that the systems may have
    for name in config.stability.only or []:
        if not name.endswith(generic):
            yield from choice("stability.only", name, (*table.perturbations(), *own))


def _unread(config: Config) -> Iterator[str]:
    """Complain of keys of the senses that no class reads and that resemble one which is read."""
    model = config.model
    for name in model.senses if model.baseline is None else ():
        where, sense = f"model.{name}", model.sense(name)
        decoder = _decoder_keys(find_class(where, sense.node))
        taken, pairs = {each.name for each in fields(sense)}, []
        for part, node in sense.node.items():
            if isinstance(node, Mapping) and TARGET in node:
                called = {*inspect.signature(find_callable(f"{where}.{part}", node)).parameters}
                pairs.append((f"{where}.{part}", node, called))
                taken |= called - {*node}
        if isinstance(sense, CustomSignalConfig | CustomPhotoConfig):
            pairs.append((where, sense.node, taken))
        if decoder:  # else a user's sense reads them by itself
            pairs.append((f"{where}.decode", sense.decode, taken | decoder))
        for place, given, known in pairs:
            for key in (key for key in given if key not in known and not key.startswith("_")):
                if near := nearest(key, known, f"{place}."):
                    yield f"{place}.{shorten(key)} is read by no class{near}: correct it"


def _decoder_keys(cls: type[Any]) -> set[str]:
    """Return the settings of the decoder of a sense; none if a user's class does not say."""
    made = getattr(getattr(cls, "make_decoder", None), "__annotations__", {}).get("return")
    return {each.name for each in fields(made)} if is_dataclass(made) else set()


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


def _unknown(given: DictConfig, known: DictConfig, prefix: str) -> Iterator[str]:
    for key in map(str, given):
        if key not in known.keys():  # noqa: SIM118  (`in known` is false for open values)
            if not _may_be_own(given, prefix, key):
                yield f"{prefix}{key}"
        elif OmegaConf.get_type(known, key) is dict:
            continue  # of classes that check them themselves
        elif OmegaConf.is_dict(known._get_node(key)) and not OmegaConf.is_missing(given, key):
            yield from _unknown(given[key], known[key], f"{prefix}{key}.")


def _may_be_own(given: DictConfig, prefix: str, key: str) -> bool:
    """Whether a key is a flag of Lightning's, or of a sense of the user's own."""
    if prefix == "model.":
        return OmegaConf.is_dict(given[key]) and TARGET in given[key]
    if prefix == "model.fusion.":
        return key.endswith(CHECKPOINT)
    return prefix == "trainer." or (not prefix and given.task in READ_FILES)


def check_shares(config: Config, processes: int) -> None:
    """Refuse batches that ``processes`` processes cannot share evenly.

    Raises:
        UserError: Naming the batch sizes.
    """
    complaints: list[str] = []
    for kind in config.model.trained:
        section = getattr(config.model, kind)
        size = section.fit.batch_size
        # the statistics of one sample at one position are no statistics
        normalised = getattr(section, "norm", None) == "batch"
        least = (2 if normalised and processes > 1 else 1) * processes
        if size % processes or size < least:
            complaints.append(
                f"model.{kind}.fit.batch_size is {size}, but {processes} processes share every "
                f"batch: choose a multiple of {processes}, {least} or more"
            )
    _refuse(complaints)
