"""Compose the systems of a family, train and test them on the same folds, and time them."""

import itertools
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import combinations
from math import ceil
from pathlib import Path
from statistics import fmean, median
from typing import Any, NamedTuple

from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.check import check_config
from tex_lightning.config.composition import Job
from tex_lightning.config.instantiation import INSTALL, missing_library, named_classes, trust
from tex_lightning.config.tasks import AUTO, EVERY_SENSE
from tex_lightning.config.weights import read_config
from tex_lightning.core.devices import pick_device
from tex_lightning.core.files import read_record
from tex_lightning.core.progress import stage
from tex_lightning.data.decode import Decoder
from tex_lightning.data.folds import make_samples
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.store import load_sample, skipped_entry
from tex_lightning.errors import UserError
from tex_lightning.evaluation.comparison import partner
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes, write_results
from tex_lightning.evaluation.samples import run_test
from tex_lightning.inference.early_stopping import SEQUENTIAL, make_inference_model
from tex_lightning.studies.dataset import Dataset, open_dataset, show_opening
from tex_lightning.studies.fold import fit_fold
from tex_lightning.studies.timing import interleaved, waiting

DONE = "measured.json"
NETWORKS = "networks"
OWN_SECTIONS = ("task", "frontier", "crossval")  # keys that say nothing of a single system
WARM_UP = 3
TIMED = 15  # tested samples, at most, that every system is timed on
Pair = tuple[int, int]  # folds that networks are trained without

log = logging.getLogger(__name__)


@dataclass
class System:
    """One system of the family, and the results of training and testing it.

    Attributes:
        name: Its name in the family.
        overrides: Its own, beside those of the user.
        config: Its composed configuration.
        entry: Facts of the first fold's network: parameters, arithmetic, checkpoint.
        fit_seconds: Mean over the trainings, parts of a FusionNet included.
        tests: Outcomes by tested fold.
        partners: Of each tested fold the outcomes of the same networks on its partner, see
            :func:`~tex_lightning.evaluation.comparison.partner`.
    """

    name: str
    overrides: list[str]
    config: Config
    entry: dict[str, Any] = field(default_factory=dict)
    fit_seconds: float = 0.0
    tests: dict[int, list[Outcome]] = field(default_factory=dict)
    partners: dict[int, list[Outcome]] = field(default_factory=dict)

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
    only = config.frontier.only or list(family)
    if unknown := [name for name in only if name not in family]:
        raise UserError(
            f"frontier.only names {unknown[0]}, which this family does not have: choose from "
            f"{', '.join(family)}."
        )
    members = [compose_system(name, own, job) for name, own in family.items() if name in only]
    _check_libraries(members)
    return members


def compose_system(name: str, own: Sequence[str], job: Job) -> System:
    """Compose a system: its own overrides, and the user's others.

    A single source of weights is meant for published trunks; a system without one gets none.
    """
    asked = [*with_system(job, own), "task=frontier", "data.val_fold=null"]
    member = read_config(job.compose(asked))
    published = any(hasattr(member.model.sense(name), "trunk") for name in member.model.senses)
    if isinstance(member.weights, str) and not published:
        member, own = replace(member, weights=None), [*own, "weights=null"]
    member = replace(member, task="crossval")
    check_config(member)
    trust(*named_classes(member.model.nodes))
    return System(name, list(own), member)


def with_system(job: Job, own: Sequence[str]) -> list[str]:
    """Overrides of a system alone: its own replace the user's of the same keys."""
    keys = {_key(item) for item in own}
    given = [item for item in job.overrides if item != f"model={AUTO}" and _key(item) not in keys]
    return [*(each for each in given if _key(each).split(".")[0] not in OWN_SECTIONS), *own]


def _key(override: str) -> str:
    return override.lstrip("+~").partition("=")[0]


def _check_libraries(members: Sequence[System]) -> None:
    """Make sure that all systems can be run, before time is spent on the first."""
    needed = {member.name: member.config.model.baseline for member in members}
    missing = {
        name: library
        for name, baseline in needed.items()
        if baseline is not None and (library := missing_library(baseline))
    }
    if missing:
        systems = ", ".join(f"{name} ({library})" for name, library in missing.items())
        others = ",".join(name for name in needed if name not in missing)
        raise UserError(
            f"Libraries of these systems are not installed: {systems}; run: {INSTALL}, or do "
            f"without them: frontier.only=[{others}]."
        )


def _subsets(config: Config, job: Job) -> dict[str, str]:
    """Systems of every subset of the senses asked for: all at once, or the next only if unsure.

    Raises:
        UserError: If the data has recordings of no known sense, or cannot be read.
    """
    if config.frontier.senses is None:
        return {}
    senses = chosen_senses(config)
    given = [item for item in job.overrides if item != f"model={AUTO}"]
    model = job.compose(given).model.name
    systems = {}
    for order, least in (("", 1), (SEQUENTIAL, 2)):
        for count in range(least, len(senses) + 1):
            for subset in combinations(senses, count):
                name = "_".join(filter(None, ["+".join(subset), order]))
                how = f" decision={order}" if order else ""
                systems[name] = f"model={model} model.senses=[{','.join(subset)}]{how}"
    return systems


def chosen_senses(config: Config) -> list[str]:
    """Senses whose subsets are compared: those named, or all known ones that the data has.

    Raises:
        UserError: If the data has recordings of no known sense, or cannot be read.
    """
    if config.frontier.senses != EVERY_SENSE:
        return list(config.frontier.senses)
    model = config.model
    modalities = {name: model.sense(name).modality for name in model.known}
    table = read_recordings(config.data, list(dict.fromkeys(modalities.values())))
    present = {row.modality for row in table}
    found = [name for name, modality in modalities.items() if modality in present]
    if not found:
        raise UserError(
            f"The data has recordings of {', '.join(sorted(present))}, and no sense reads these: "
            f"known are {', '.join(modalities)}; write conf/sense/NAME.yaml for another."
        )
    return found


def measure_family(members: Sequence[System], folds: Sequence[int], directory: Path) -> None:
    """Train every system without each of ``folds`` and its partner, and test it on both.

    What a run in the same folder has finished is read.

    Args:
        members: The systems, whose results are filled in.
        folds: Folds that are tested.
        directory: Holds a folder for each system; the networks, each trained once, lie beside it.
    """
    pairs = {member.name: _pairs(member, folds) for member in members}
    missing = {
        name: [pair for pair in dict.fromkeys(own.values()) if not _done(directory / name, pair)]
        for name, own in pairs.items()
    }
    shown: set[str] = set()
    with stage("training", sum(map(len, missing.values()))) as trainings:
        for member in members:
            dataset: Dataset | None = None
            home = directory / member.name
            for pair in missing[member.name]:
                log.info("%s, trained without folds %d and %d.", member.name, *pair)
                trainings.update(trainings.done, title=member.name)
                dataset = dataset or open_dataset(member.config, home)
                if not shown.issuperset(dataset.store.decoders):  # each modality once
                    shown |= {*dataset.store.decoders}
                    names = ", ".join(each.name for each in members)
                    show_opening(member.config, dataset, f"{len(members)} systems: {names}")
                _measure_pair(dataset, pair, _place(home, pair), directory.parent / NETWORKS)
                trainings.update(trainings.done + 1)
    for member in members:
        _read(member, pairs[member.name], directory / member.name)


def _pairs(member: System, folds: Sequence[int]) -> dict[int, Pair]:
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


def _measure_pair(dataset: Dataset, pair: Pair, home: Path, networks_in: Path) -> None:
    rows, config = dataset.recordings, dataset.config
    apart = Recordings(tuple(row for row in rows if row.fold == pair[1]))
    on_fold = replace(dataset, recordings=rows.without(apart)).on_fold(pair[0])
    networks = fit_fold(on_fold, home, test_parts=False, networks_in=networks_in)
    entry = networks[config.model.kind]
    samples = make_samples(apart, config.model.modalities)
    trained = load_classifier(entry["checkpoint"])
    classifier = make_inference_model(trained, config.engine, config.decision)
    outcomes = run_test(classifier, samples, dataset.store)
    write_outcomes(outcomes, _predictions(home, config.model.kind, pair[1], pair))
    seconds = sum(network["fit_seconds"] for network in networks.values())
    skipped = skipped_entry(dataset.skipped)
    write_results(home / DONE, {**entry, "fit_seconds": seconds, "skipped": skipped})


def _read(member: System, pairs: Mapping[int, Pair], directory: Path) -> None:
    kind = member.config.model.kind
    entries = [
        read_record(_place(directory, pair) / DONE) for pair in dict.fromkeys(pairs.values())
    ]
    member.entry = entries[0]
    member.fit_seconds = fmean(entry["fit_seconds"] for entry in entries)
    for fold, pair in pairs.items():
        other = pair[1] if fold == pair[0] else pair[0]
        place = _place(directory, pair)
        member.tests[fold] = read_outcomes(_predictions(place, kind, fold, pair))
        member.partners[fold] = read_outcomes(_predictions(place, kind, other, pair))


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


def measure_latencies(members: Sequence[System], rounds: int) -> Timings:
    """Times of one sample, all systems interleaved in one run.

    The samples are of the first tested fold: of those that a network was trained on it is surer,
    and a sequential decision quicker, than it will be.

    Args:
        members: The systems, measured.
        rounds: In each every system classifies one sample.
    """
    functions: dict[str, Callable[[], object]] = {}
    counts: dict[str, int] = {}
    recordings: dict[tuple[tuple[str, Decoder], ...], list[dict[str, Tensor]]] = {}
    for member in members:
        config = member.config
        device = pick_device(config.trainer.accelerator)
        trained = load_classifier(member.entry["checkpoint"]).to(device)
        classifier = make_inference_model(trained, config.engine, config.decision)
        decoded = tuple((each.modality, each.decoder) for each in trained.senses.values())
        if decoded not in recordings:  # such systems classify the same samples
            recordings[decoded] = _timed_samples(member)
        counts[member.name] = len(recordings[decoded])
        call = partial(_classify_next, classifier, itertools.cycle(recordings[decoded]))
        functions[member.name] = waiting(call, device)
    log.info("Timing %d systems on the same samples.", len(functions))
    timings = interleaved(functions, rounds, WARM_UP)
    return {
        name: Latency(_mean_of_samples(timing.calls, counts[name]), timing.median, timing.p95)
        for name, timing in timings.items()
    }


def _timed_samples(member: System) -> list[dict[str, Tensor]]:
    """Samples of the first tested fold, which the first network has not seen."""
    dataset = open_dataset(member.config, Path(member.entry["checkpoint"]).parent)
    outcomes = next(iter(member.tests.values()))
    files = {path for outcome in outcomes for path in outcome.files.values()}
    strange = (row for row in dataset.recordings if row.source not in files)
    samples = make_samples(dataset.recordings.without(strange), member.config.model.modalities)
    timed = samples[:: ceil(len(samples) / TIMED)]
    return [load_sample(sample, dataset.store) for sample in timed]


def _mean_of_samples(calls: Sequence[float], count: int) -> float:
    """Mean over samples that take turns of each one's median time."""
    return fmean(median(calls[sample::count]) for sample in range(min(count, len(calls))))


def _classify_next(classifier: SurfaceClassifier, samples: Iterator[dict[str, Tensor]]) -> object:
    """Another sample each time: what a sequential decision costs depends on the sample."""
    return classifier.classify(**next(samples))
