"""The systems of a family: what each composes to, trained and tested on the same folds.

Each tested fold has a validation fold of its own, which takes no part in training.
"""

import json
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hydra import compose
from hydra.core.hydra_config import HydraConfig

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.check import check_config
from tex_lightning.config.weights import read_config
from tex_lightning.data.folds import make_samples
from tex_lightning.data.recordings import Recordings
from tex_lightning.data.unusable import skipped_entry
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import Outcome, read_outcomes, write_outcomes, write_results
from tex_lightning.evaluation.samples import run_test
from tex_lightning.inference.early_stopping import prepare
from tex_lightning.runs.fold import fit_fold
from tex_lightning.runs.workspace import Workspace, open_workspace

log = logging.getLogger(__name__)

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
        tests: Outcomes on the tested folds.
        validation: Outcomes on their validation folds.
    """

    member: Member
    entry: dict[str, Any]
    fit_seconds: float
    tests: list[Outcome]
    validation: list[Outcome]


def compose_family(config: Config, shared: Path) -> Iterator[Member]:
    """Compose every system of the family with whatever else the user asked for.

    Networks that differ in nothing but how they are run are trained once, in ``shared``.

    Raises:
        UserError: If a system is unknown or its configuration cannot be used.
    """
    family, only = config.frontier.systems, config.frontier.only
    unknown = [name for name in only or () if name not in family]
    if unknown:
        raise UserError(
            f"frontier.only names {unknown[0]}, which this family does not have: choose from "
            f"{', '.join(family)}."
        )
    for name in only or family:
        overrides = tuple(family[name].split())
        training = with_system(given_overrides(), overrides)
        member = read_config(compose("config", overrides=[*training, "task=crossval"]))
        member = replace(member, crossval=replace(member.crossval, share=str(shared)))
        check_config(member)
        yield Member(name, overrides, member)


def measure(member: Member, folds: list[int], directory: Path) -> Measured:
    """Train and test on every fold, or read what an interrupted run has left."""
    log.info("System %s.", member.name)
    workspace: Workspace | None = None
    entries, tests, validation = [], [], []
    for fold in folds:
        place = directory / str(fold)
        if not (place / DONE).is_file():
            workspace = workspace or open_workspace(member.config, directory)
            _measure_fold(workspace, fold, place)
        entries.append(json.loads((place / DONE).read_text(encoding="utf-8")))
        kind = member.config.model.kind
        tests += read_outcomes(place / "predictions" / f"{kind}.csv")
        validation += read_outcomes(place / "validation.csv")
    seconds = sum(entry["fit_seconds"] for entry in entries) / len(entries)
    return Measured(member, entries[0], seconds, tests, validation)


def validation_fold(fold: int, folds: int) -> int:
    """The fold that choices are made on when ``fold`` is tested: the one half the folds away."""
    return (fold + folds // 2) % folds


def _measure_fold(workspace: Workspace, fold: int, directory: Path) -> None:
    held = validation_fold(fold, workspace.config.data.folds)
    folds = workspace.config.data.folds
    kept = tuple(row for row in workspace.recordings if row.group % folds != held)
    inner = replace(workspace, recordings=Recordings(kept)).on_fold(fold, directory)
    networks = fit_fold(inner)
    entry = networks[workspace.kind]
    rows = tuple(row for row in workspace.recordings if row.group % folds == held)
    samples = make_samples(Recordings(rows), workspace.kind)
    classifier = prepare(load_classifier(entry["checkpoint"]), workspace.config)
    outcomes = run_test(classifier, samples, workspace.store)
    write_outcomes(outcomes, directory / "validation.csv")
    seconds = sum(network["fit_seconds"] for network in networks.values())
    skipped = skipped_entry(workspace.skipped)
    write_results(directory / DONE, {**entry, "fit_seconds": seconds, "skipped": skipped})


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
