"""The systems of a family: what each composes to, trained and tested on the same folds."""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Any

from hydra import compose
from hydra.core.hydra_config import HydraConfig

from tex_lightning.config import Config
from tex_lightning.config.check import check_config
from tex_lightning.config.instantiation import INSTALL, missing_library
from tex_lightning.config.trust import trust
from tex_lightning.config.weights import read_config
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.unusable import skipped_entry
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_results
from tex_lightning.runs.fold import fit_fold
from tex_lightning.runs.remaining import Remaining
from tex_lightning.runs.workspace import Workspace, open_workspace

OWN_KEYS = ("task=", "frontier", "model=", "crossval.", "data.val_fold", "hydra")
DONE = "measured.json"


@dataclass(frozen=True)
class Member:
    """One system of the family: its name, its overrides and what they compose to."""

    name: str
    overrides: tuple[str, ...]
    config: Config


@dataclass(frozen=True)
class Measured:
    """What training and testing a member gave.

    Attributes:
        member: The system.
        entry: Facts of the first fold's network: parameters, arithmetic, checkpoint.
        fit_seconds: Mean over the folds, parts of a FusionNet included.
        tests: Outcomes by tested fold.
    """

    member: Member
    entry: dict[str, Any]
    fit_seconds: float
    tests: dict[int, list[Outcome]]

    @property
    def outcomes(self) -> list[Outcome]:
        """Outcomes of all tested folds."""
        return [outcome for tested in self.tests.values() for outcome in tested]


def compose_family(config: Config, shared: Path, held: Sequence[str] = ()) -> Iterator[Member]:
    """Compose the systems asked for, and those ``held``, with whatever else the user asked for.

    Networks that differ in nothing but how they are run are trained once, in ``shared``.

    Raises:
        UserError: If a system is unknown or its configuration cannot be used.
    """
    systems, only = config.frontier.systems, config.frontier.only
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
        overrides = tuple(family[name].split())
        training = with_system(given_overrides(), overrides)
        member = read_config(compose("config", overrides=[*training, "task=frontier"]))
        crossval = replace(member.crossval, share=str(shared))
        member = replace(member, task="crossval", crossval=crossval)
        check_config(member)
        trust(member)
        yield Member(name, overrides, member)


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
    members: Sequence[Member], folds: Sequence[int], directory: Path, excluded: int | None = None
) -> list[Measured]:
    """Train every member on all folds but the tested one, and test it, for each of ``folds``.

    What a run in the same folder has finished is read.

    Args:
        members: The systems.
        folds: That are tested.
        directory: Holds a folder for each system.
        excluded: A fold that is neither trained nor tested.
    """
    places = {
        member.name: {fold: directory / member.name / "folds" / str(fold) for fold in folds}
        for member in members
    }
    missing = {
        name: [fold for fold, place in own.items() if not (place / DONE).is_file()]
        for name, own in places.items()
    }
    pairs = [(name, fold) for name, missed in missing.items() for fold in missed]
    remaining = Remaining(list(places), folds, pairs)
    for member in members:
        workspace: Workspace | None = None
        for fold in missing[member.name]:
            with remaining.measuring(member.name, fold):
                workspace = workspace or _open(member, directory, excluded)
                _measure_fold(workspace, fold, places[member.name][fold])
    return [_read(member, places[member.name]) for member in members]


def _open(member: Member, directory: Path, excluded: int | None) -> Workspace:
    workspace = open_workspace(member.config, directory / member.name)
    folds, rows = member.config.data.folds, workspace.recordings
    kept = Recordings(tuple(row for row in rows if row.group % folds != excluded))
    return replace(workspace, recordings=kept)


def _measure_fold(workspace: Workspace, fold: int, directory: Path) -> None:
    networks = fit_fold(workspace.on_fold(fold, directory))
    seconds = sum(network["fit_seconds"] for network in networks.values())
    skipped = skipped_entry(workspace.skipped)
    entry = {**networks[workspace.kind], "fit_seconds": seconds, "skipped": skipped}
    write_results(directory / DONE, entry)


def _read(member: Member, places: Mapping[int, Path]) -> Measured:
    entries = [json.loads((place / DONE).read_text(encoding="utf-8")) for place in places.values()]
    predictions = Path("predictions") / f"{member.config.model.kind}.csv"
    tests = {fold: read_outcomes(place / predictions) for fold, place in places.items()}
    return Measured(member, entries[0], fmean(entry["fit_seconds"] for entry in entries), tests)


def with_system(given: Sequence[str], overrides: Sequence[str]) -> list[str]:
    """What trains a system with what the user asked for.

    One source of weights is meant for networks on photos: a system on traces goes without it.
    """
    without = [item for item in given if not item.startswith("weights=")]
    if len(without) < len(given):
        composed = compose("config", overrides=[*given, *overrides])
        if composed.model.kind == "haptic" and isinstance(composed.weights, str):
            return [*without, *overrides]
    return [*given, *overrides]


def given_overrides() -> list[str]:
    """What the user asked for beside the family."""
    return [item for item in HydraConfig.get().overrides.task if not item.startswith(OWN_KEYS)]
