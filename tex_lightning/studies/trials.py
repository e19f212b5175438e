"""Trials of a system under a perturbation: run, kept on disk to continue from, summarised."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tex_lightning.core.files import write_text
from tex_lightning.core.progress import track
from tex_lightning.errors import UserError
from tex_lightning.evaluation.calibration import auroc
from tex_lightning.evaluation.outcomes import wilson_interval
from tex_lightning.perturbations.table import BOTH, SEVERITIES, SWAPPED, Perturbation, perturbations
from tex_lightning.studies.perturbed import Decision, System

Key = tuple[str, str, float]  # system, perturbation, severity
RECORD = "trials.jsonl"


class Record:
    """One JSON line per trial, added when the trial is done.

    Args:
        path: The file; what it holds already is read. A last line that is cut off is left out.

    Raises:
        UserError: If another line is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.trials: dict[Key, list[Decision]] = {}
        if path.is_file():
            lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
            whole = [line for line in lines if line.endswith("\n")]
            if len(whole) < len(lines):
                write_text(path, "".join(whole))
            for number, line in enumerate(whole, start=1):
                try:
                    *key, made = json.loads(line)
                    system, perturbation, severity = key
                    self.trials[system, perturbation, severity] = [Decision(*one) for one in made]
                except (TypeError, ValueError) as error:
                    raise UserError(
                        f"Line {number} of {path} is damaged; delete that line and run the same "
                        "command again."
                    ) from error

    def add(self, key: Key, decisions: Sequence[Decision]) -> None:
        """Keep the decisions of one trial."""
        self.trials[key] = list(decisions)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        line = json.dumps([*key, [astuple(each) for each in decisions]])
        with self.path.open("a", encoding="utf-8") as stream:
            stream.write(line + "\n")


MAX_CLASSES = 3  # named as those that go first


@dataclass(frozen=True)
class Trial:
    """Decisions beside the clean ones; a refused sample counts as wrong.

    Attributes:
        system: The system.
        perturbation: The perturbation.
        severity: 0, which is clean, to 5.
        labels: True class index of every sample.
        clean: Decisions on the clean samples.
        decisions: Decisions on the perturbed samples.
    """

    system: System
    perturbation: Perturbation
    severity: float
    labels: list[int]
    clean: list[Decision]
    decisions: list[Decision]

    @property
    def votes_correct(self) -> list[bool]:
        """Whether each sample got its class."""
        return [
            made.label == label for made, label in zip(self.decisions, self.labels, strict=True)
        ]

    @property
    def correct(self) -> int:
        """Number of samples that got their class."""
        return sum(self.votes_correct)

    @property
    def accuracy(self) -> float:
        """Share of samples that got their class."""
        return self.correct / len(self.labels)

    @property
    def flip_rate(self) -> float:
        """Share of samples whose decision, refusal included, is not the clean one."""
        pairs = zip(self.decisions, self.clean, strict=True)
        return sum(made.label != before.label for made, before in pairs) / len(self.labels)

    @property
    def refused(self) -> int:
        """Number of samples that the classifier refused."""
        return sum(made.label is None for made in self.decisions)

    def probability_when(self, correct: bool) -> float | None:
        """Mean probability of the decisions that are correct, or wrong; None if there are none."""
        values = [
            made.probability
            for made, is_correct in zip(self.decisions, self.votes_correct, strict=True)
            if is_correct == correct and made.label is not None
        ]
        return float(np.mean(values)) if values else None

    def class_accuracy(self) -> dict[str, float]:
        """Accuracy of every class that was tested."""
        correct: dict[str, list[bool]] = {}
        for name, is_correct in zip(self.system.labels, self.votes_correct, strict=True):
            correct.setdefault(name, []).append(is_correct)
        return {name: float(np.mean(values)) for name, values in correct.items()}


@dataclass(frozen=True)
class BreakingPoint:
    """The severity, also between whole ones, at which a system falls below the bound.

    Attributes:
        clean: Vote accuracy without perturbation.
        least: Vote accuracy that it has to keep.
        below: The mildest trial found below that; None if severity 5 is not.
        classes: Those that lost most there.
    """

    clean: float
    least: float
    below: Trial | None
    classes: list[str]


Break = tuple[System, Perturbation, BreakingPoint]


class Bench:
    """Run trials, each once.

    Args:
        systems: Those under test.
        record: Record of the trials that are done.
    """

    def __init__(self, systems: Sequence[System], record: Record) -> None:
        self.systems = systems
        self.record = record
        self._clean = {
            system.name: system.clean() for system in track(systems, "recordings as they are")
        }
        self._labels = {system.name: system.wanted for system in systems}

    def trial(self, system: System, perturbation: Perturbation, severity: float) -> Trial:
        """The decisions of one system."""
        key, clean = (system.name, perturbation.name, severity), self._clean[system.name]
        if severity > 0 and key not in self.record.trials:
            self.record.add(key, system.decide(perturbation, severity))
        made = self.record.trials[key] if severity > 0 else clean
        return Trial(system, perturbation, severity, self._labels[system.name], clean, made)

    def grid(self, perturbations: Sequence[Perturbation]) -> Iterator[Trial]:
        """Trials of every perturbation, severity 0 to 5, and system that meets it."""
        for perturbation in perturbations:
            meeting = [system for system in self.systems if system.meets(perturbation)]
            for severity in (0, *SEVERITIES):
                for system in meeting:
                    yield self.trial(system, perturbation, severity)

    def breaking_point(
        self, system: System, perturbation: Perturbation, bound: float, steps: int
    ) -> BreakingPoint:
        """Find the mildest severity below the bound.

        The first whole severity below it is taken, and the stretch before that bisected; an
        accuracy that recovers later does not count.

        Args:
            system: One that meets the perturbation.
            perturbation: The perturbation.
            bound: Share of the clean vote accuracy that has to be kept.
            steps: Bisections of the stretch.
        """
        clean = self.trial(system, perturbation, 0)
        least = bound * clean.accuracy
        trials = (self.trial(system, perturbation, severity) for severity in SEVERITIES)
        below = next((trial for trial in trials if trial.accuracy < least), None)
        if below is None:
            return BreakingPoint(clean.accuracy, least, None, [])
        kept = below.severity - 1
        for _ in range(steps):
            middle = self.trial(system, perturbation, (kept + below.severity) / 2)
            if middle.accuracy < least:
                below = middle
            else:
                kept = middle.severity
        return BreakingPoint(clean.accuracy, least, below, _losers(clean, below))


def _losers(clean: Trial, below: Trial) -> list[str]:
    before, after = clean.class_accuracy(), below.class_accuracy()
    losses = {name: before[name] - after[name] for name in before}
    ranked = sorted((name for name in losses if losses[name] > 0), key=lambda name: -losses[name])
    return ranked[:MAX_CLASSES]


Errors = dict[str, float]


def summarise_system(system: System, trials: Sequence[Trial], reference: Errors) -> dict[str, Any]:
    """The entry of one system in ``results.json``.

    Args:
        system: The system.
        trials: Trials of all systems, severities 0 to 5.
        reference: :func:`mean_errors` of the reference system.
    """
    own = [trial for trial in trials if trial.system is system and trial.severity > 0]
    errors = mean_errors(own)
    entry: dict[str, Any] = {
        "kind": system.kind,
        "checkpoints": [str(member.checkpoint) for member in system.members],
        "perturbations": len(errors),
    }
    if not own:
        return entry
    clean = Trial(system, own[0].perturbation, 0, own[0].labels, own[0].clean, own[0].clean)
    held = {trial.perturbation.name for trial in own if trial.perturbation.held_out}
    worst = max(errors, key=lambda name: errors[name])
    classes = _class_accuracy(own)
    lowest = min(classes, key=lambda name: classes[name])
    return {
        **entry,
        "clean": {
            "vote_accuracy": clean.accuracy,
            "vote_ci95": wilson_interval(clean.correct, len(clean.labels)),
            "correct": clean.correct,
            "test_samples": len(clean.labels),
        },
        "mean_error": float(np.mean(list(errors.values()))),
        "mean_error_held_out": _mean([errors[name] for name in held]),
        "corruption_error": corruption_error(errors, reference),
        "corruption_error_held_out": corruption_error(
            {name: errors[name] for name in held}, reference
        ),
        "mean_flip_rate": float(np.mean([trial.flip_rate for trial in own])),
        "refused": sum(trial.refused for trial in own),
        "probability_when_wrong": _mean([trial.probability_when(False) for trial in own]),
        "probability_when_correct": _mean([trial.probability_when(True) for trial in own]),
        "worst_perturbation": {"name": worst, "mean_error": errors[worst]},
        "worst_class": {"name": lowest, "vote_accuracy": classes[lowest]},
        "perturbation_errors": errors,
    }


def mean_errors(trials: Sequence[Trial]) -> Errors:
    """Error of the votes, mean over severities 1 to 5, by the name of the perturbation."""
    errors: dict[str, list[float]] = {}
    for trial in trials:
        if trial.severity > 0:
            errors.setdefault(trial.perturbation.name, []).append(1 - trial.accuracy)
    return {name: float(np.mean(values)) for name, values in errors.items()}


def corruption_error(errors: Errors, reference: Errors) -> dict[str, Any] | None:
    """Mean corruption error: errors over those of the reference, mean over shared perturbations.

    As Hendrycks and Dietterich (2019) with another reference. A perturbation under which the
    reference makes no error has no ratio and is left out.

    Returns:
        ``mean``, and ``perturbations``, how many it is over; None if there are none.
    """
    shared = [name for name in errors if reference.get(name, 0) > 0]
    if not shared:
        return None
    mean = float(np.mean([errors[name] / reference[name] for name in shared]))
    return {"mean": mean, "perturbations": len(shared)}


def conflict_summary(system: System, bench: Bench) -> dict[str, Any]:
    """How well a FusionNet separates samples with recordings of two classes from those of one.

    The area under the ROC curve of three scores, each high for a conflict: 1 - agreement of the
    beliefs of its parts, 1 - share of the votes, and 1 - mean probability of the label. Every
    sample is there once as it is and once with each modality swapped. A system without such a
    perturbation has none.
    """
    swaps = [
        each
        for each in perturbations().values()
        if each.modality == BOTH and each.effect[1] == SWAPPED and system.meets(each)
    ]
    if not swaps:
        return {}
    clean = bench.trial(system, swaps[0], 0).decisions
    swapped = [
        made for each in swaps for made in bench.trial(system, each, SEVERITIES[-1]).decisions
    ]
    scores = {
        "conflict_auroc": "agreement",
        "conflict_auroc_share": "share",
        "conflict_auroc_probability": "probability",
    }
    return {
        name: auroc(_conflicts(clean, score), _conflicts(swapped, score))
        for name, score in scores.items()
    }


def _conflicts(decisions: Sequence[Decision], score: str) -> list[float]:
    """1 - the score of every decision that has it; a sample that was refused has none."""
    found = [getattr(made, score) for made in decisions if made.label is not None]
    return [1 - value for value in found if value is not None]


def _class_accuracy(trials: Sequence[Trial]) -> dict[str, float]:
    tables = [trial.class_accuracy() for trial in trials]
    return {name: float(np.mean([table[name] for table in tables])) for name in tables[0]}


def _mean(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.mean(present)) if present else None
