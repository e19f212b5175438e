"""A system under test: a classifier for each fold, with that fold's test samples."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.data.unusable import Unusable
from tex_lightning.perturbations.table import BOTH, FEWER, MISSING, Perturbation
from tex_lightning.stability.evaluator import Decision, Evaluator, Scores
from tex_lightning.stability.perturbed import PerturbedDataset

See = Callable[[str, Recording], Scores | None]  # of a sense


@dataclass
class Member:
    """One classifier and its test samples.

    Attributes:
        checkpoint: Where it was loaded from.
        evaluator: The classifier.
        samples: Those it has not trained on.
        dataset: Where their recordings are.
        skipped: Files of its test that cannot be used and were left out.
    """

    checkpoint: Path
    evaluator: Evaluator
    samples: list[Sample]
    dataset: PerturbedDataset
    skipped: Sequence[Unusable] = ()
    _clean: dict[tuple[str, Recording], Scores | None] = field(default_factory=dict)

    def clean(self) -> list[Decision]:
        """Decisions on the samples as they are."""
        return [self._decide(sample.recordings, self._see) for sample in self.samples]

    def decide(self, perturbation: Perturbation, severity: float) -> list[Decision]:
        """Decisions on the perturbed samples."""
        if perturbation.modality == BOTH:
            return [self._combine(sample, perturbation, severity) for sample in self.samples]
        seen: dict[tuple[str, Recording], Scores | None] = {}

        def see(sense: str, row: Recording) -> Scores | None:
            if row.modality != perturbation.modality:
                return self._see(sense, row)
            if (sense, row) not in seen:
                array = self.dataset.perturbed(row, perturbation, severity)
                seen[sense, row] = self.evaluator.score(array, sense)
            return seen[sense, row]

        return [self._decide(sample.recordings, see) for sample in self.samples]

    def _see(self, sense: str, row: Recording) -> Scores | None:
        if (sense, row) not in self._clean:
            self._clean[sense, row] = self.evaluator.score(self.dataset.clean(row), sense)
        return self._clean[sense, row]

    def _decide(
        self, rows: Mapping[str, Recording], see: See, count: int | None = None
    ) -> Decision:
        """Decide by recordings, by modality; senses whose modality is missing are left out."""
        scores = {
            sense: see(sense, rows[modality])
            for sense, modality in self.evaluator.modalities.items()
            if modality in rows
        }
        return self.evaluator.together(scores, count)

    def _combine(self, sample: Sample, perturbation: Perturbation, severity: float) -> Decision:
        """Recordings that are whole, put together wrongly."""
        value, rows = perturbation.value(severity), dict(sample.recordings)
        if perturbation.name == FEWER:
            return self._decide(rows, self._see, max(1, round(value)))
        modality, becomes = perturbation.effect
        rng = self.dataset.rng(perturbation.name, *rows.values())
        if rng.random() < value:
            row = rows.pop(modality)
            if becomes != MISSING:
                rows[modality] = self.dataset.partner(row, rng)
        return self._decide(rows, self._see)


@dataclass
class System:
    """One named line of every table.

    Attributes:
        name: Unlike those of the other systems.
        kind: The sense that it reads, or ``fusion`` of several.
        members: One for each fold that is tested.
    """

    name: str
    kind: str
    members: list[Member]

    @property
    def modalities(self) -> tuple[str, ...]:
        """Modalities of the recordings that it reads."""
        return tuple(dict.fromkeys(self.members[0].evaluator.modalities.values()))

    @property
    def samples(self) -> Iterator[tuple[Member, Sample]]:
        """All samples, fold by fold."""
        return ((member, sample) for member in self.members for sample in member.samples)

    @property
    def labels(self) -> list[str]:
        """True class of every sample."""
        return [sample.label for _, sample in self.samples]

    @property
    def wanted(self) -> list[int]:
        """True class of every sample as an index of the classes of its classifier."""
        return [member.evaluator.classes.index(sample.label) for member, sample in self.samples]

    def clean(self) -> list[Decision]:
        """Decisions on all samples as they are."""
        return [decision for member in self.members for decision in member.clean()]

    def decide(self, perturbation: Perturbation, severity: float) -> list[Decision]:
        """Decisions on all samples, perturbed."""
        return [
            decision
            for member in self.members
            for decision in member.decide(perturbation, severity)
        ]

    def meets(self, perturbation: Perturbation) -> bool:
        """Whether the system reads what the perturbation changes."""
        modality, axes = perturbation.modality, perturbation.axes
        if modality == BOTH:
            hit = perturbation.name == FEWER or perturbation.effect[0] in self.modalities
            return hit and len(self.modalities) > 1
        if modality not in self.modalities:
            return False
        return axes is None or all(
            member.dataset.axes(member.samples, modality) == {axes} for member in self.members
        )
