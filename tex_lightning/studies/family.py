"""Compose the systems of a family, train and test them on the same folds, and time them."""

import itertools
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from math import ceil
from pathlib import Path
from statistics import fmean, median
from typing import Any, NamedTuple

from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config, FrontierConfig
from tex_lightning.config.check import check_config
from tex_lightning.config.composition import Job
from tex_lightning.config.instantiation import INSTALL, missing_library, named_classes, trust
from tex_lightning.config.weights import read_config
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record
from tex_lightning.core.progress import stage
from tex_lightning.data.decode import Decoder
from tex_lightning.data.folds import make_samples
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import load_sample, skipped_entry
from tex_lightning.errors import UserError
from tex_lightning.evaluation.comparison import partner
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes, write_results
from tex_lightning.evaluation.samples import run_test
from tex_lightning.inference.early_stopping import make_inference_model
from tex_lightning.studies.console_summary import Opening
from tex_lightning.studies.dataset import Workspace, open_workspace
from tex_lightning.studies.fold import fit_fold
from tex_lightning.studies.timing import interleaved, waiting

TASK_KEYS = ("task=", "frontier", "hydra")
OWN_KEYS = (*TASK_KEYS, "model=", "crossval.", "data.val_fold")
DONE = "measured.json"
NETWORKS = "networks"
Pair = tuple[int, int]  # folds that networks are trained without


@dataclass(frozen=True)
class Member:
    """One system of the family: its name, its overrides and its composed configuration."""

    name: str
    overrides: tuple[str, ...]
    config: Config


@dataclass(frozen=True)
class Measured:
    """Results of training and testing a member.

    Attributes:
        member: The system.
        entry: Facts of the first fold's network: parameters, arithmetic, checkpoint.
        fit_seconds: Mean over the trainings, parts of a FusionNet included.
        tests: Outcomes by tested fold.
        partners: Of each tested fold the outcomes of the same networks on its partner, see
            :func:`~tex_lightning.evaluation.comparison.partner`.
    """

    member: Member
    entry: dict[str, Any]
    fit_seconds: float
    tests: dict[int, list[Outcome]]
    partners: dict[int, list[Outcome]]

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcomes of all tested folds."""
        return [outcome for tested in self.tests.values() for outcome in tested]


def compose_family(
    frontier: FrontierConfig, job: Job, held: Sequence[str] = ()
) -> Iterator[Member]:
    """Compose the requested systems, and those ``held``, with the user's other overrides.

    Networks that differ in nothing but how they are run are trained once, in a folder of the run.

    Raises:
        UserError: If a system is unknown or its configuration cannot be used.
    """
    systems, only = frontier.systems, frontier.only
    family = {name: overrides for name, overrides in systems.items() if overrides is not None}
    unknown = [name for name in only or () if name not in family]
    if unknown:
        raise UserError(
            f"frontier.only names {unknown[0]}, which this family does not have: choose from "
            f"{', '.join(family)}."
        )
    for name in family:
        if only and name not in (*only, *held):
            continue
        overrides = _split_overrides(name, family[name])
        training = with_system(job, given_overrides(job), overrides)
        member = read_config(job.compose([*training, "task=frontier"]))
        member = replace(member, task="crossval")
        check_config(member)
        trust(*named_classes(member.model.nodes))
        yield Member(name, overrides, member)


def _split_overrides(name: str, given: str) -> tuple[str, ...]:
    overrides = tuple(given.split())
    for item in overrides:
        if item.startswith(TASK_KEYS):
            raise UserError(
                f"frontier.systems.{name} has {item}, but says only what is trained and how it is "
                "run; leave it out."
            )
    return overrides


def check_libraries(members: Sequence[Member]) -> None:
    """Make sure that all systems can be run, before time is spent on the first.

    Raises:
        UserError: Naming those whose libraries are missing and what does without them.
    """
    needed = {member.name: member.config.model.baseline for member in members}
    missing = {
        name: library
        for name, baseline in needed.items()
        if baseline is not None and (library := missing_library(baseline))
    }
    if not missing:
        return
    listed = ", ".join(f"{name} ({library})" for name, library in missing.items())
    others = [name for name in needed if name not in missing]
    without = f", or do without them: frontier.only=[{','.join(others)}]" if others else ""
    raise UserError(
        f"Libraries of these systems are not installed: {listed}; run: {INSTALL}{without}."
    )


def measure_family(
    members: Sequence[Member], folds: Sequence[int], directory: Path, opening: Opening
) -> list[Measured]:
    """Train every member without each of ``folds`` and its partner, and test it on both.

    What a run in the same folder has finished is read.

    Args:
        members: The systems.
        folds: Folds that are tested.
        directory: Holds a folder for each system; the networks, each trained once, lie beside it.
        opening: Says what was found.
    """
    pairs = {member.name: _pairs(member, folds) for member in members}
    missing = {
        name: [pair for pair in dict.fromkeys(own.values()) if not _done(directory / name, pair)]
        for name, own in pairs.items()
    }
    left = sum(map(len, missing.values()))
    with stage("training", left) as trainings:
        for number, member in enumerate(members):
            workspace: Workspace | None = None
            home = directory / member.name
            for pair in missing[member.name]:
                log.info(
                    "System %d of %d (%s), trained without folds %d and %d.",
                    number + 1, len(members), member.name, *pair,
                )  # fmt: skip
                trainings.update(trainings.done, title=member.name)
                workspace = workspace or open_workspace(member.config, home, opening)
                _measure_pair(workspace, pair, _place(home, pair), directory.parent / NETWORKS)
                trainings.update(trainings.done + 1)
    return [_read(member, pairs[member.name], directory / member.name) for member in members]


def _pairs(member: Member, folds: Sequence[int]) -> dict[int, Pair]:
    """Of each tested fold itself and its partner, in one order for both unless networks differ."""
    data = member.config.data
    both = {fold: (fold, partner(fold, data.folds)) for fold in folds}
    if data.inverted:  # a fold is then what is trained on
        return both
    return {fold: (min(pair), max(pair)) for fold, pair in both.items()}


def _place(directory: Path, pair: Pair) -> Path:
    return directory / "folds" / f"{pair[0]}-{pair[1]}"


def _done(directory: Path, pair: Pair) -> bool:
    return (_place(directory, pair) / DONE).is_file()


def _predictions(place: Path, kind: str, fold: int, pair: Pair) -> Path:
    """The file of the votes on one of the two folds."""
    return place / "predictions" / (f"{kind}.csv" if fold == pair[0] else f"{kind}_partner.csv")


def _measure_pair(workspace: Workspace, pair: Pair, directory: Path, networks_in: Path) -> None:
    rows = workspace.recordings
    apart = Recordings(tuple(row for row in rows if row.fold == pair[1]))
    kept = rows.without(apart)
    on_fold = replace(workspace, recordings=kept).on_fold(pair[0], directory)
    networks = fit_fold(on_fold, test_parts=False, networks_in=networks_in)
    entry = networks[workspace.kind]
    config = workspace.config
    samples = make_samples(apart, config.model.modalities)
    trained = load_classifier(entry["checkpoint"])
    classifier = make_inference_model(trained, config.engine, config.decision)
    outcomes = run_test(classifier, samples, workspace.store)
    write_outcomes(outcomes, _predictions(directory, workspace.kind, pair[1], pair))
    seconds = sum(network["fit_seconds"] for network in networks.values())
    skipped = skipped_entry(workspace.skipped)
    write_results(directory / DONE, {**entry, "fit_seconds": seconds, "skipped": skipped})


def _read(member: Member, pairs: Mapping[int, Pair], directory: Path) -> Measured:
    kind = member.config.model.kind
    places = [_place(directory, pair) for pair in dict.fromkeys(pairs.values())]
    entries = [read_record(place / DONE) for place in places]
    tests, partners = {}, {}
    for fold, pair in pairs.items():
        other = pair[1] if fold == pair[0] else pair[0]
        place = _place(directory, pair)
        tests[fold] = read_outcomes(_predictions(place, kind, fold, pair))
        partners[fold] = read_outcomes(_predictions(place, kind, other, pair))
    seconds = fmean(entry["fit_seconds"] for entry in entries)
    return Measured(member, entries[0], seconds, tests, partners)


def with_system(job: Job, given: Sequence[str], system: Sequence[str]) -> list[str]:
    """The overrides that train a system, the user's others included.

    A single source of weights is meant for published trunks: a system without such a trunk gets
    neither it nor the weights of a preset.
    """
    without = [item for item in given if not item.startswith("weights=")]
    preset = [item for item in given if item.startswith("experiment=")]
    if preset or len(without) < len(given):
        composed = job.compose([*given, *system])
        published = any("trunk" in composed.model[sense] for sense in composed.model.senses)
        if not published and isinstance(composed.weights, str):
            return [*without, *system, *(["weights=null"] if preset else [])]
    return [*given, *system]


def given_overrides(job: Job) -> list[str]:
    """The user's overrides beside the family."""
    return [item for item in job.overrides if not item.startswith(OWN_KEYS)]


log = logging.getLogger(__name__)
WARM_UP = 3
TIMED = 15  # tested samples, at most, that every system is timed on


class Latency(NamedTuple):
    """Time of one sample in ms.

    Attributes:
        mean: Over the samples: that of a sequential decision is short for some and long for others.
        median: Median of all calls.
        p95: Their 95th percentile.
    """

    mean: float
    median: float
    p95: float


Timings = dict[str, Latency]


def measure_latencies(measured: Sequence[Measured], rounds: int, opening: Opening) -> Timings:
    """Times of one sample, all systems interleaved in one run.

    The samples are of the first tested fold: of those that a network was trained on it is surer,
    and a sequential decision quicker, than it will be.

    Args:
        measured: The systems.
        rounds: In each every system classifies one sample.
        opening: Says what was found.
    """
    functions: dict[str, Callable[[], object]] = {}
    counts: dict[str, int] = {}
    recordings: dict[tuple[tuple[str, Decoder], ...], list[dict[str, Tensor]]] = {}
    for system in measured:
        member, config = system.member, system.member.config
        device = pick_device(config.trainer.accelerator)
        trained = load_classifier(system.entry["checkpoint"]).to(device)
        classifier = make_inference_model(trained, config.engine, config.decision)
        decoded = tuple((each.modality, each.decoder) for each in trained.senses.values())
        if decoded not in recordings:  # such systems classify the same samples
            home = Path(system.entry["checkpoint"]).parent
            workspace = open_workspace(config, home, opening)
            samples = make_samples(_tested(system, workspace), config.model.modalities)
            timed = samples[:: ceil(len(samples) / TIMED)]
            recordings[decoded] = [load_sample(sample, workspace.store) for sample in timed]
        counts[member.name] = len(recordings[decoded])
        call = partial(_classify_next, classifier, itertools.cycle(recordings[decoded]))
        functions[system.member.name] = waiting(call, device)
    log.info("Timing %d systems on the same samples.", len(functions))
    timings = interleaved(functions, rounds, WARM_UP)
    return {
        name: Latency(_mean_of_samples(timing.calls, counts[name]), timing.median, timing.p95)
        for name, timing in timings.items()
    }


def _tested(system: Measured, workspace: Workspace) -> Recordings:
    """Recordings of the first tested fold, which the first network has not seen."""
    outcomes = next(iter(system.tests.values()))
    files = {path for outcome in outcomes for path in outcome.files.values()}
    return workspace.recordings.without(
        row for row in workspace.recordings if row.source not in files
    )


def _mean_of_samples(calls: Sequence[float], count: int) -> float:
    """Mean over samples that take turns of each one's median time."""
    return fmean(median(calls[sample::count]) for sample in range(min(count, len(calls))))


def _classify_next(classifier: SurfaceClassifier, samples: Iterator[dict[str, Tensor]]) -> object:
    """Another sample each time: what a sequential decision costs depends on the sample."""
    return classifier.classify(**next(samples))
