"""Compose the systems of a family, train and test them on the same folds, and choose one."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from pathlib import Path
from statistics import fmean
from typing import Any

from tex_lightning.baselines.classifier import make_baseline
from tex_lightning.config import Config, Job
from tex_lightning.config.check import check_config, read_config
from tex_lightning.config.composition import compose_for
from tex_lightning.config.instantiation import named_classes, trust
from tex_lightning.core.progress import Stage
from tex_lightning.core.run_folder import RESULTS, predictions_of
from tex_lightning.errors import UserError, shorten
from tex_lightning.evaluation.comparison import correct_shares, one_standard_error, pareto
from tex_lightning.evaluation.metrics import METRICS, metrics_in, pooled_metrics
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes
from tex_lightning.inference.early_stopping import SEQUENTIAL
from tex_lightning.learning.provenance import note_recordings
from tex_lightning.report.table import model_label
from tex_lightning.studies.description import show_opening
from tex_lightning.studies.fold import finished_results, open_training, run_fold

log = logging.getLogger(__name__)
NETWORKS = "networks"
OWN_SECTIONS = ("task", "frontier", "crossval")  # keys that say nothing of a single system
UNSAID = ("model", "experiment", "weights")  # keys that are no part of a name for readers
SAID_BY_VALUE = ("decision", "model.senses")
COLUMNS = {  # of ``frontier.csv``, with the metric that each has; further metrics come last
    "parameters": "parameters",
    "macs": "macs_per_sample",
    "latency_ms_median": "latency_ms",
    "latency_ms_p95": "latency_ms_p95",
    "fit_seconds": "fit_seconds",
    "vote_accuracy": "vote_accuracy",
    "ci_low": "ci_low",
    "ci_high": "ci_high",
}


@dataclass
class System:
    """One system of the family, and the results of training and testing it.

    Attributes:
        name: Name in the family.
        label: Name for readers, unlike those of the others, too.
        overrides: Overrides of the system, in addition to the user's.
        config: Composed configuration.
        entry: Facts of the first fold's network: parameters, arithmetic, checkpoint.
        fit_seconds: Mean over the trainings, parts of a FusionNet included.
        tests: Outcomes by tested fold.
    """

    name: str
    overrides: list[str]
    config: Config
    entry: dict[str, Any] = field(default_factory=dict)
    fit_seconds: float = 0.0
    tests: dict[int, list[Outcome]] = field(default_factory=dict)
    label: str = ""

    @property
    def cost(self) -> float:
        """Mean time of one sample in ms: a sequential decision is short for some."""
        return fmean(outcome.latency_ms for outcome in self.outcomes)

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcomes of all tested folds."""
        return [outcome for tested in self.tests.values() for outcome in tested]


def compose_family(config: Config, job: Job) -> list[System]:
    """Compose the requested systems with the user's other overrides.

    Networks that differ in nothing but how they are run are trained once, in a folder of the run.

    Raises:
        UserError: If a system is unknown, its configuration cannot be used or a library is missing.
    """
    systems = {**_subsets(config, job), **config.frontier.systems}
    family = {name: text.split() for name, text in systems.items() if text is not None}
    _check_model(family, job)
    only = config.frontier.only or list(family)
    if unknown := [name for name in only if name not in family]:
        raise UserError(
            f"frontier.only names {unknown[0]}, which this family does not have: choose from "
            f"{', '.join(family)}."
        )
    composed = [compose_system(name, family[name], job) for name in family if name in only]
    label_systems(composed)
    return composed


def _check_model(family: Mapping[str, Sequence[str]], job: Job) -> None:
    """Reject a model that the user gives and no system has: it would have no effect."""
    asked = [item for item in job.overrides if _key(item) == "model"][-1:]
    named = [item for overrides in family.values() for item in overrides if _key(item) == "model"]
    if asked and len(named) == len(family) and asked[0] not in named:
        raise UserError(
            f"No system of this family has {shorten(asked[0])}; choose a family, such as "
            "frontier=visual, or add a system to it, as in "
            f"'+frontier.systems.mine=\"{shorten(asked[0])}\"'."
        )


def label_systems(systems: Sequence[System]) -> None:
    """Give each system a name for readers: its model, and what it sets."""
    labels = [_label(system) for system in systems]
    for system, label in zip(systems, labels, strict=True):
        system.label = label if labels.count(label) == 1 else f"{label} ({system.name})"


def _label(system: System) -> str:
    settings = dict(item.lstrip("+~").partition("=")[::2] for item in system.overrides)
    first = model_label(system.config.model.name)
    senses = settings.get("model.senses", "").strip("[]").split(",")
    if system.name.startswith("+".join(senses) or " "):  # one of their subsets
        first = " + ".join(senses)
        del settings["model.senses"]
    said = [_say(key, settings) for key in settings if key not in UNSAID]
    return ", ".join(dict.fromkeys([first, *said]))


def _say(key: str, settings: Mapping[str, str]) -> str:
    """Return a setting in words: its key by the last part, or two where that means several."""
    value, parts = settings[key], key.split(".")
    if key in SAID_BY_VALUE:
        return value.strip("[]").replace(",", " + ")
    alike = {settings[other] for other in settings if other.split(".")[-1] == parts[-1]}
    name = " ".join(parts[-1 if len(alike) == 1 else -2 :]).replace("_", " ")
    return {"true": name, "false": f"no {name}"}.get(value, f"{name} {value}")


def compose_system(name: str, overrides: Sequence[str], job: Job) -> System:
    """Compose a system: its own overrides, and the user's others.

    A single source of weights is meant for published trunks; a system without one gets none.
    """
    asked = [*with_system(job, overrides), "task=frontier", "data.val_fold=null"]
    config = read_config(compose_for(job, asked))
    published = any(hasattr(config.model.sense(sense), "trunk") for sense in config.model.senses)
    if isinstance(config.weights, str) and not published:
        config, overrides = replace(config, weights=None), [*overrides, "weights=null"]
    config = replace(config, task="crossval")
    check_config(config)
    trust(*named_classes(config.model.nodes))
    model = config.model
    if model.baseline is not None:
        make_baseline(model.name, model.baseline, model.budget)  # whose library may be missing
    return System(name, list(overrides), config)


def with_system(job: Job, overrides: Sequence[str]) -> list[str]:
    """Return overrides of a system alone: its own replace the user's of the same keys."""
    keys = {_key(item) for item in overrides}
    kept = [item for item in job.overrides if _key(item) not in keys]
    return [*(item for item in kept if _key(item).split(".")[0] not in OWN_SECTIONS), *overrides]


def _key(override: str) -> str:
    return override.lstrip("+~").partition("=")[0]


def _subsets(config: Config, job: Job) -> dict[str, str]:
    """Return systems of every subset of the senses: all at once, or the next only if unsure."""
    if config.frontier.senses is None:
        return {}
    models = [item.partition("=")[2] for item in job.overrides if item.startswith("model=")]
    model = models[-1] if models else config.model.name
    senses, systems = config.frontier.senses, {}
    for decision, smallest in (("", 1), (SEQUENTIAL, 2)):
        for count in range(smallest, len(senses) + 1):
            for subset in combinations(senses, count):
                name = "_".join(filter(None, ["+".join(subset), decision]))
                how = f" decision={decision}" if decision else ""
                systems[name] = f"model={model} model.senses=[{','.join(subset)}]{how}"
    return systems


def measure_family(systems: Sequence[System], folds: Sequence[int], directory: Path) -> None:
    """Train every system without each of ``folds``, and test it there.

    What a run in the same folder has finished is read. The directory gets a folder for each system;
    networks that they share are in a folder beside it.
    """
    what = f"{len(systems)} systems: {', '.join(system.label for system in systems)}"
    shared, shown = directory.parent / NETWORKS, set[str]()
    with Stage("system", len(systems)) as level:
        for number, system in enumerate(systems):
            level.update(number, title=system.label)
            which = f"System {number + 1}/{len(systems)}, {system.label}"
            homes = {fold: directory / system.name / "folds" / str(fold) for fold in folds}
            log.info("%s: %s.", which, _announced(homes))
            entries = _run_folds(system.config, homes, shared, what, shown)
            kind = system.config.model.kind
            seconds = [sum(part["fit_seconds"] for part in entry.values()) for entry in entries]
            system.entry, system.fit_seconds = entries[0][kind], fmean(seconds)
            system.tests = {
                fold: read_outcomes(predictions_of(home, kind)) for fold, home in homes.items()
            }
            right = sum(outcome.correct for outcome in system.outcomes)
            log.info(
                "%s: %d/%d correct, %.3g ms for a sample, fitted in %.3g s a fold.",
                which, right, len(system.outcomes), system.cost, system.fit_seconds,
            )  # fmt: skip


def _announced(homes: Mapping[int, Path]) -> str:
    """Return what is to be done: the folds that no earlier run has finished."""
    left = [fold for fold, home in homes.items() if not (home / RESULTS).is_file()]
    if not left:
        return "trained already"
    return f"training without fold{'s' * (len(left) > 1)} {', '.join(map(str, left))}"


def _run_folds(
    config: Config, homes: Mapping[int, Path], shared: Path, what: str, shown: set[str]
) -> list[dict[str, Any]]:
    """Return the networks of each fold's results, trained unless an earlier run did so.

    Modalities whose recordings an opening has ``shown`` are not shown again; others are added.
    """
    dataset, entries = None, []
    for fold, home in homes.items():
        results = finished_results(home, f"Fold {fold}")
        if not results:
            if dataset is None:
                dataset = open_training(config, home)
                note_recordings([*dataset.recordings, *dataset.unknown], home.parents[1])
            if not shown.issuperset(dataset.store.decoders):
                shown |= {*dataset.store.decoders}
                trains = [config.on_fold(fold).data for fold in homes]
                show_opening(config.data, dataset, what, trains=trains)
            results = run_fold(config.on_fold(fold), dataset, home, shared=shared)
        entries.append(results["networks"])
    return entries


def tested_samples(systems: Sequence[System]) -> tuple[str, float]:
    """Return the number of test samples, in which senses may differ, and the accuracy of guessing.

    A tested fold may lack classes, which are guessed nevertheless.
    """
    counts = sorted({len(system.outcomes) for system in systems})
    said = " to ".join(map(str, dict.fromkeys((counts[0], counts[-1]))))
    return f"{said} test samples", 1 / len(systems[0].outcomes[0].class_probabilities)


def choose_system(systems: Sequence[System]) -> System:
    """Choose a system by its time and its accuracy on samples of all senses."""
    widths = [len(system.config.model.modalities) for system in systems]
    joint = systems[widths.index(max(widths))].tests
    named = {system.name: system for system in systems}
    votes = {
        name: {
            (fold, recording): share
            for fold in joint
            for recording, share in correct_shares(system.tests[fold], joint[fold]).items()
        }
        for name, system in named.items()
    }
    return named[one_standard_error({name: x.cost for name, x in named.items()}, votes)]


def frontier_rows(systems: Sequence[System], chosen: System) -> list[dict[str, Any]]:
    """Return the rows of ``frontier.csv``, fastest first."""
    entries = {system.name: _entry(system) for system in systems}
    points = {
        system.name: (system.cost, entries[system.name]["vote_accuracy"]) for system in systems
    }
    line = pareto(points)
    further = [metric for metric in metrics_in("frontier") if metric.name not in COLUMNS.values()]
    rows = []
    for system in sorted(systems, key=lambda system: system.cost):
        entry = entries[system.name]
        row = {
            "system": system.name,
            "kind": system.config.model.kind,
            **{column: METRICS[name].of(entry) for column, name in COLUMNS.items()},
            "on_frontier": system.name in line,
            "chosen": system is chosen,
            "latency_ms_mean": system.cost,
            "name": system.label,
            **{metric.name: metric.of(entry) for metric in further},
        }
        rows.append(row)
    return rows


def _entry(system: System) -> dict[str, Any]:
    """Return what ``results.json`` would say of a system on all tested folds."""
    pooled = pooled_metrics(system.outcomes, calibrated=False)
    macs = system.entry["macs_per_sample"]
    if macs is not None:  # those that a sequential decision does not do are left out
        macs = round(macs * pooled.get("relative_macs", 1))
    return {
        **system.entry, **pooled, "macs_per_sample": macs, "fit_seconds": system.fit_seconds
    }  # fmt: skip
