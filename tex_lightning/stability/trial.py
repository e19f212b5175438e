"""One system under one perturbation at one severity, and the search for where it breaks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tex_lightning.perturbations.table import SEVERITIES, Perturbation
from tex_lightning.progress import track
from tex_lightning.stability.evaluator import Decision
from tex_lightning.stability.record import Record
from tex_lightning.stability.system import System

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
