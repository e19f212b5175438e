"""Systems under test: classifiers, the test samples of their folds, clean or perturbed.

A recording is perturbed once for all systems. A FusionNet computes its partial
logits for each recording once, however many samples it is part of, and decides as in any test.
"""

import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier, content_seed
from tex_lightning.classifier.vote import probabilities
from tex_lightning.data.folds import Sample
from tex_lightning.data.recordings import Recording, write_part
from tex_lightning.data.store import Store, Unusable, fingerprint
from tex_lightning.errors import UserError
from tex_lightning.perturbations.pixels import Array, Scene
from tex_lightning.perturbations.table import BOTH, FEWER, MISSING, Perturbation


@dataclass(frozen=True)
class Scores:
    """Scores of one recording by one sense of a classifier.

    Attributes:
        recording: Signal or photo; a FusionNet draws its tuples by it.
        scores: Class scores (classes, positions) by this recording alone.
        partial_logits: What it adds to those of a FusionNet; the same at level FC2.
    """

    recording: Array
    scores: Tensor
    partial_logits: Tensor

    @property
    def belief(self) -> Tensor:
        """Mean class probabilities (classes,) by this recording alone, float64."""
        return probabilities(self.scores) / self.scores.shape[1]


@dataclass(frozen=True)
class Decision:
    """The decision on one sample.

    Attributes:
        label: Class index; None if the classifier refused the sample.
        share: Share of the votes.
        probability: Mean probability of the label over the fragments.
        agreement: Where several senses decided, the probability that draws from the beliefs of two
            of them are the same class, mean over all twos; else None.
    """

    label: int | None
    share: float = 0.0
    probability: float = 0.0
    agreement: float | None = None


REFUSED = Decision(None)


class Evaluator:
    """Decide by the scores of recordings.

    Args:
        classifier: In evaluation mode, as prediction runs it.

    Attributes:
        modalities: By the name of each sense, what it looks at.
    """

    def __init__(self, classifier: SurfaceClassifier) -> None:
        self.classifier = classifier
        self.classes = classifier.card.classes
        senses = classifier.card.senses
        self.modalities: dict[str, str] = {name: senses[name]["modality"] for name in senses}

    @torch.inference_mode()
    def score(self, recording: Array, sense: str) -> Scores | None:
        """Class scores of every position of a recording; None if it is refused."""
        try:
            features = self.classifier.positions(sense, torch.from_numpy(np.array(recording)))
        except UserError:
            return None
        partial_logits = self.classifier.project(sense, features)
        scores = partial_logits if self.classifier.level(sense) == "fc2" else features
        return Scores(recording, scores.cpu(), partial_logits.cpu())

    @torch.inference_mode()
    def alone(self, scores: Scores | None) -> Decision:
        """Decide by one recording; so does a FusionNet whose other modalities are missing."""
        return REFUSED if scores is None else self._decide(scores.scores, 1)

    @torch.inference_mode()
    def together(self, scores: Mapping[str, Scores | None], count: int | None = None) -> Decision:
        """Decide by the recordings of some senses; those of the others are missing.

        Args:
            scores: By the name of each sense, in the order of the card.
            count: Number of tuples; None takes the card's.
        """
        found = {sense: each for sense, each in scores.items() if each is not None}
        if not found or len(found) < len(scores):
            return REFUSED
        if len(found) == 1:
            return self.alone(*found.values())
        # a modality that several senses look at counts once
        looked_at = {self.modalities[sense]: each.recording for sense, each in found.items()}
        seed = content_seed(self.classifier.card.decision["seed"], *looked_at.values())
        joined = self.classifier.fuse([each.partial_logits for each in found.values()], seed, count)
        return self._decide(joined, len(found), _agreement(found.values()))

    def _decide(self, scores: Tensor, senses: int, agreement: float | None = None) -> Decision:
        card = self.classifier.card
        # some of the senses have no temperature of their own: `Card.of`
        temperature = card.temperature if senses == len(card.sense_names) else 1.0
        vote = self.classifier.decide(scores, temperature)
        return Decision(vote.label, float(vote.shares[vote.label]), vote.probability, agreement)


def _agreement(found: Iterable[Scores]) -> float:
    beliefs = [each.belief for each in found]
    return float(np.mean([float(one @ other) for one, other in combinations(beliefs, 2)]))


@dataclass
class PerturbedDataset:
    """Decoded recordings of one store, clean and perturbed.

    Everything random depends on the seed, the perturbation and the content of the file alone, so
    that every system and every severity meets the same chances.

    Attributes:
        store: Decoded files.
        seed: Seed of everything random.
    """

    store: Store
    seed: int

    def __post_init__(self) -> None:
        self.rows: dict[str, Recording] = {}
        self._fingerprint = cache(lambda path: int(fingerprint(path), 16))
        self._now: tuple[Perturbation, float] | None = None
        self._perturbed: dict[Recording, Array] = {}

    def add(self, rows: Iterable[Recording]) -> None:
        """Add recordings, which may be classified and may serve as partners of others."""
        self.rows.update((row.source, row) for row in rows)

    def clean(self, row: Recording) -> Array:
        """The recording as decoded."""
        return self.store.load(row)

    def perturbed(self, row: Recording, perturbation: Perturbation, severity: float) -> Array:
        """The recording perturbed; those of the latest perturbation and severity are kept."""
        if self._now != (perturbation, severity):
            self._now, self._perturbed = (perturbation, severity), {}
        if row not in self._perturbed:
            rng = self.rng(perturbation.name, row)
            rate = getattr(self.store.decoders[row.modality], "sampling_rate", 0.0)
            scene = Scene(rng, rate, lambda: np.array(self.clean(self.partner(row, rng))))
            self._perturbed[row] = perturbation.apply(np.array(self.clean(row)), severity, scene)
        return self._perturbed[row]

    def rng(self, name: str, *rows: Recording) -> np.random.Generator:
        """The generator of one sample under one perturbation."""
        prints = [self._fingerprint(row.path) for row in rows]
        prints += [zlib.crc32(write_part(row.part).encode()) for row in rows if row.part]
        return np.random.default_rng([self.seed, zlib.crc32(name.encode()), *prints])

    def partner(self, row: Recording, rng: np.random.Generator) -> Recording:
        """A recording of the same modality and another class, of the same fold if there is one."""
        others = [
            other
            for _, other in sorted(self.rows.items())
            if other.modality == row.modality and other.label != row.label
        ]
        near = [other for other in others if other.fold == row.fold]
        choice = near or others
        return choice[int(rng.integers(len(choice)))]

    def axes(self, samples: Iterable[Sample], modality: str) -> set[int]:
        """Numbers of axes that the signals of some samples have."""
        return {len(self.clean(each.recordings[modality])) for each in samples}


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
