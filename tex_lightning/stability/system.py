"""A system under test: a classifier for each fold, with that fold's test samples."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tex_lightning.data.folds import NEEDS, Kind, Sample
from tex_lightning.data.recordings import Recording
from tex_lightning.data.unusable import Unusable
from tex_lightning.perturbations.table import Perturbation
from tex_lightning.stability.evaluator import Decision, Evaluator, Scores
from tex_lightning.stability.perturbed import PerturbedDataset

See = Callable[[Recording], Scores | None]


@dataclass
class Member:
    """One classifier and what it is tested on.

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
    _clean: dict[Recording, Scores | None] = field(default_factory=dict)

    def clean(self) -> list[Decision]:
        """Decisions on the samples as they are."""
        return [self._decide(sample, self._see) for sample in self.samples]

    def decide(self, perturbation: Perturbation, severity: float) -> list[Decision]:
        """Decisions on the perturbed samples."""
        if perturbation.modality == "both":
            return [self._combine(sample, perturbation, severity) for sample in self.samples]
        seen: dict[Recording, Scores | None] = {}

        def see(row: Recording) -> Scores | None:
            if row.modality != perturbation.modality:
                return self._see(row)
            if row not in seen:
                array = self.dataset.perturbed(row, perturbation, severity)
                seen[row] = self.evaluator.score(array, row.modality)
            return seen[row]

        return [self._decide(sample, see) for sample in self.samples]

    def _see(self, row: Recording) -> Scores | None:
        if row not in self._clean:
            array = self.dataset.clean(row)
            self._clean[row] = self.evaluator.score(array, row.modality)
        return self._clean[row]

    def _decide(self, sample: Sample, see: See) -> Decision:
        if sample.haptic is not None and sample.image is not None:
            return self.evaluator.together(see(sample.haptic), see(sample.image))
        row = sample.haptic or sample.image
        return self.evaluator.alone(None if row is None else see(row))

    def _combine(self, sample: Sample, perturbation: Perturbation, severity: float) -> Decision:
        """A trace and a photo that are whole, put together wrongly."""
        haptic, image = sample.haptic, sample.image
        assert haptic is not None and image is not None  # noqa: PT018
        value, name = perturbation.value(severity), perturbation.name
        if name == "fewer_pairs":
            pairs = max(1, round(value))
            return self.evaluator.together(self._see(haptic), self._see(image), pairs)
        rng = self.dataset.rng(name, haptic, image)
        if rng.random() >= value:
            return self._decide(sample, self._see)
        if name == "haptic_missing":
            return self.evaluator.alone(self._see(image))
        if name == "image_missing":
            return self.evaluator.alone(self._see(haptic))
        if name == "haptic_swapped":
            haptic = self.dataset.partner(haptic, rng)
        else:
            image = self.dataset.partner(image, rng)
        return self.evaluator.together(self._see(haptic), self._see(image))


@dataclass
class System:
    """One named line of every table.

    Attributes:
        name: Unlike those of the other systems.
        kind: haptic, visual or fusion.
        members: One for each fold that is tested.
    """

    name: str
    kind: Kind
    members: list[Member]

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
        """The same as indices of the classes of the classifier that judges it."""
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
        if perturbation.modality == "both":
            return self.kind == "fusion"
        if perturbation.modality not in NEEDS[self.kind]:
            return False
        return perturbation.axes is None or all(
            member.dataset.axes(member.samples) == {perturbation.axes} for member in self.members
        )
