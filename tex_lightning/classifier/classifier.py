"""The classifier: features, networks and decision in one module.

A :class:`Card` of plain values rebuilds it, and a checkpoint holds the card and the weights, so
that prediction from raw files does exactly what testing did.
"""

import zlib
from collections.abc import Iterable, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from tex_lightning.classifier.card import LEFT_OUT, Card, damaged, named, read_checkpoint
from tex_lightning.classifier.statistics import FeatureStatistics
from tex_lightning.classifier.vote import RULES, Vote, random_tuples
from tex_lightning.config.model import FUSION
from tex_lightning.errors import UserError
from tex_lightning.networks.archives import SizeLimit, check_numbers
from tex_lightning.networks.blocks import Head, Level, score_layer_of
from tex_lightning.networks.fusionnet import FusionNet
from tex_lightning.senses.base import Sense, content, make_sense

PREFIX = "classifier."  # in the state of a LightningModule
STATISTICS = "statistics."  # in its own


@dataclass(frozen=True)
class SenseOutput:
    """Scores and novelty of one recording by one sense.

    Attributes:
        partial_logits: (classes, positions) that it adds to the class scores.
        novelty: () how unlike the training its mean features are; None if not known.
    """

    partial_logits: Tensor
    novelty: Tensor | None


class SurfaceClassifier(nn.Module):
    """Classify decoded recordings.

    One branch decides by its own class scores; those of several branches add up (FusionNet).

    Attributes:
        card: The plain values that it was built from.
        features: The features of each branch, by the name of the sense.
        network: The network of the only branch, or the FusionNet of all.
        statistics: By the name of the sense, the
            :class:`~tex_lightning.classifier.statistics.FeatureStatistics` of what
            :meth:`embedding` gives for the training recordings; empty before training has ended,
            and of a checkpoint written without them.
        tile: Most elements of an input that go through a network at once; None never divides.

    Example:
        >>> import tex_lightning as tl, torch
        >>> classifier = tl.load("RUN").classifier
        >>> trace, photo = torch.randn(3, 24_000), torch.zeros(240, 240, 3, dtype=torch.uint8)
        >>> classifier.logits(haptic=trace, image=photo).shape  # of classes and pairs of fragments
        torch.Size([3, 50])
        >>> vote = classifier.classify(haptic=trace, image=photo)
        >>> vote.label in (0, 1, 2)
        True
    """

    def __init__(self, card: Card) -> None:
        super().__init__()
        self.card = card
        self.tile: int | None = None
        senses = self.make_senses()
        networks = [sense.network for sense in senses.values()]
        self.features = nn.ModuleDict({name: each.features for name, each in senses.items()})
        self.network: nn.Module = (
            networks[0]
            if len(networks) == 1
            else FusionNet(*networks, classes=len(card.classes), **card.fusion)
        )
        self.statistics = nn.ModuleDict()
        empty = nn.Module()  # :meth:`sense` puts each together again
        self._templates = {
            name: replace(each, features=empty, network=empty) for name, each in senses.items()
        }

    def make_senses(self) -> dict[str, Sense]:
        """Make the senses of the card, with random weights."""
        nodes, classes = self.card.senses.items(), len(self.card.classes)
        return {name: make_sense(name, node, classes) for name, node in nodes}

    @classmethod
    def from_checkpoint(cls, path: str | Path, kind: str | None = None) -> "SurfaceClassifier":
        """Load a checkpoint of this package, ready to classify on the CPU.

        Args:
            path: The file.
            kind: Required kind of network; None accepts any.

        Raises:
            UserError: If the file is missing, damaged, from elsewhere, a baseline's or of another
                kind.
        """
        return read_trained(path, kind).classifier

    @classmethod
    def from_content(cls, path: Path, stored: dict[str, Any]) -> "SurfaceClassifier":
        """Build the classifier that a checkpoint holds, ready to classify on the CPU.

        Args:
            path: The file, for messages.
            stored: What :func:`~tex_lightning.classifier.card.read_checkpoint` gave.

        Raises:
            UserError: As :meth:`from_checkpoint`.
        """
        try:
            card = Card.from_dict(stored["hyper_parameters"]["card"])
            if card.baseline:
                raise UserError(
                    f"Checkpoint {path} holds {card.title}, and this needs one of this package's "
                    "networks; give another file."
                )
            with SizeLimit(path.stat().st_size):
                classifier = cls(card)
            state = own_state(stored)
            classifier.expect_statistics(state)
            check_numbers(state)
            classifier.load_state_dict(state)
        except UserError as error:
            raise named(path, error) from error
        except Exception as error:  # damage shows in as many ways as there are formats
            raise damaged(path, error) from error
        return classifier.eval()

    def expect_statistics(self, state: Mapping[str, Tensor]) -> None:
        """Have statistics of the sizes in a state."""
        self.statistics = _stored_statistics(state)

    @property
    def fusion(self) -> FusionNet | None:
        """Return the FusionNet of several senses; None of a single one."""
        return cast(FusionNet, self.network) if self.card.kind == FUSION else None

    def sense(self, name: str) -> Sense:
        """Return one sense with its features and network as they are now."""
        place = self.card.sense_names.index(name)
        network = self.network if self.fusion is None else self.fusion.networks[place]
        template = self._templates[name]
        return replace(template, features=self.features[name], network=network, tile=self.tile)

    @property
    def senses(self) -> dict[str, Sense]:
        """Return all senses by name."""
        return {name: self.sense(name) for name in self.card.sense_names}

    @property
    def device(self) -> torch.device:
        """Return the device of its parameters."""
        return next(iter(self.senses.values())).device

    def count_parameters(self) -> int:
        """Count the trained parameters."""
        return sum(parameter.numel() for parameter in self.network.parameters())

    @torch.inference_mode()
    def classify(self, **recordings: Tensor) -> Vote:
        """Decide on one sample, and say how unlike the training it is; see :meth:`logits`."""
        sensed = self.sense_outputs(**recordings)
        return self.vote(sensed, self._tuple_seed(**recordings))

    @torch.inference_mode()
    def novelty(self, **recordings: Tensor) -> Tensor:
        """Return how unlike every class of the training one sample is: (), 0 to 2 for each sense.

        The sum over its senses of :meth:`.FeatureStatistics.novelty` of their mean features.

        Raises:
            UserError: If the checkpoint has no statistics, or as :meth:`logits` does.
        """
        found = join_novelties(self.sense_outputs(**recordings).values())
        if found is None:
            raise UserError(
                f"This {self.card.title} keeps no statistics of its features, so what it has never "
                "seen cannot be told; train it by task=fit."
            )
        return found

    def decide(self, logits: Tensor, temperature: float) -> Vote:
        """Decide by class scores (classes, fragments) with the card's rule."""
        return RULES[self.card.rule](logits, temperature)

    def logits(self, **recordings: Tensor) -> Tensor:
        """Return the class scores of every fragment of one sample of decoded recordings.

        Args:
            **recordings: By modality. A signal is (axes, samples) float32 at the rate of its
                sense, a photo (height, width, 3) uint8, already halved if the card says so.

        Returns:
            (classes, fragments); FusionNet's fragments are its random tuples of positions.

        Raises:
            UserError: If a modality the network needs is absent, or a recording is too small.
        """
        self.require(recordings)
        partials = [
            self.partial_logits(name, recordings[sense.modality])
            for name, sense in self.senses.items()
        ]
        return self.fuse(partials, self._tuple_seed(**recordings))

    def sense_outputs(self, **recordings: Tensor) -> dict[str, SenseOutput]:
        """Compute scores and novelty by every sense; arguments are those of :meth:`logits`."""
        self.require(recordings)
        senses = self.senses.items()
        return {name: self.sense_output(name, recordings[each.modality]) for name, each in senses}

    def sense_output(self, name: str, recording: Tensor) -> SenseOutput:
        """Compute scores and novelty of a decoded recording by one sense, in one pass."""
        return self.output_of(name, self.embedding(name, recording))

    def output_of(self, name: str, features: Tensor) -> SenseOutput:
        """Compute the same from features (D, positions), see :meth:`embedding`."""
        statistics = self.statistics_of(name)
        novelty = None if statistics is None else statistics.novelty(features.mean(dim=1))
        return SenseOutput(self._partial_logits_of(name, features), novelty)

    def statistics_of(self, name: str) -> FeatureStatistics | None:
        """Return the class statistics of one sense; None of a checkpoint without them."""
        return cast(FeatureStatistics | None, dict(self.statistics.items()).get(name))

    def vote(self, sensed: Mapping[str, SenseOutput], seed: int) -> Vote:
        """Decide by the scores of all senses; ``seed`` is that of the tuples."""
        logits = self.fuse([sensed[name].partial_logits for name in self.card.sense_names], seed)
        vote, novelty = self.decide(logits, self.card.temperature), join_novelties(sensed.values())
        return vote if novelty is None else replace(vote, novelty=float(novelty))

    def _tuple_seed(self, **recordings: Tensor) -> int:
        # it is read out of every byte of the recordings, and a single sense draws nothing
        return self.seed(**recordings) if self.fusion is not None else 0

    def seed(self, **recordings: Tensor) -> int:
        """Return the seed of the random choices for one sample of decoded recordings."""
        arrays = (content(recordings[modality]) for modality in self.card.modalities)
        return content_seed(self.card.decision["seed"], *arrays)

    def partial_logits(self, name: str, recording: Tensor) -> Tensor:
        """Compute what one sense adds to the class scores: (classes, positions).

        Args:
            name: Name of the sense.
            recording: Decoded.
        """
        return self._partial_logits_of(name, self.embedding(name, recording))

    def _partial_logits_of(self, name: str, features: Tensor) -> Tensor:
        """The partial logits of what :meth:`embedding` gives."""
        if self.embedding_layer(name) != self.level(name):
            features = class_scores(self.sense(name).network, features)
        return self.project(name, features)

    def positions(self, name: str, recording: Tensor) -> Tensor:
        """Compute features (D, positions) of the layer that is fused; of a single sense scores."""
        return self.sense(name).positions(recording, self.level(name))

    def embedding(self, name: str, recording: Tensor) -> Tensor:
        """Compute the features (D, positions) of one sense that its :attr:`statistics` are about.

        They are FC2's at every level of fusion, or the class scores of a network without a
        ``score_layer``.

        Args:
            name: Name of the sense.
            recording: Decoded.
        """
        return self.sense(name).positions(recording, self.embedding_layer(name))

    def embedding_layer(self, name: str) -> Level:
        """Return the layer of :meth:`embedding`."""
        level = self.level(name)
        if level == "fc3" and score_layer_of(self.sense(name).network) is not None:
            return "fc2"  # fusion on FC2, which removes that layer, is there already
        return level

    def level(self, name: str) -> Level:
        """Return the layer of one sense that is fused; of a single one that of the scores."""
        place = self.card.sense_names.index(name)
        return "fc3" if self.fusion is None else self.fusion.levels[place]

    def project(self, name: str, features: Tensor) -> Tensor:
        """Return the partial logits of one sense from its features (D, positions)."""
        if self.fusion is None:
            return features
        return self.fusion.project(self.card.sense_names.index(name), features[None])[0]

    def fuse(self, partials: Sequence[Tensor], seed: int, count: int | None = None) -> Tensor:
        """Return the class scores (classes, fragments) of one sample.

        Args:
            partials: Those of all senses, in order; of a single one they are the scores.
            seed: Seed of the tuples; see :func:`content_seed`.
            count: Number of tuples; None takes the card's.
        """
        if self.fusion is None:
            return partials[0]
        wanted: int = self.card.decision["pairs"] if count is None else count
        tuples = random_tuples([each.shape[-1] for each in partials], wanted, seed)
        parts = [each[None] for each in partials]
        return self.fusion.fuse(parts, tuples.to(partials[0].device))[0]

    @torch.no_grad()
    def with_senses(self, senses: Sequence[str]) -> "SurfaceClassifier":
        """Return a copy that looks at some of the senses, for samples that lack the others.

        Where FC2 is fused a single sense has no FC3 of its own; it takes its part of the fusion
        layer, so that the scores of all add up to those of the fusion. At FC3 it is the network
        with its own scores.
        """
        if self.fusion is None or tuple(senses) == self.card.sense_names:
            return self
        part = SurfaceClassifier(self.card.of(senses))
        part.tile = self.tile
        for name in senses:
            part.features[name] = deepcopy(self.features[name])
            if name in self.statistics:
                part.statistics[name] = deepcopy(self.statistics[name])
        places = [self.card.sense_names.index(name) for name in senses]
        fused = self.fusion.subset(places)
        if (
            len(self.card.sense_names) - 1 not in places
        ):  # the bias is in the partial logits of the last
            fused.head.bias.zero_()
        part.network = fused if len(places) > 1 else _alone(part, fused)
        return part.to(self.device).train(self.training)

    def require(self, given: Sequence[str] | dict[str, Any]) -> None:
        """Refuse a sample that lacks a modality.

        Raises:
            UserError: Naming it.
        """
        needs = self.card.modalities
        if absent := [modality for modality in needs if modality not in given]:
            raise UserError(
                f"This {self.card.kind} network needs {' and '.join(needs)}; give "
                f"{' and '.join(f'{key}=FILE' for key in absent)} too."
            )


def join_novelties(sensed: Iterable[SenseOutput]) -> Tensor | None:
    """The novelty of a sample: the sum over its senses; None if it is not known of all."""
    total: Tensor | None = None
    for each in sensed:
        if each.novelty is None:
            return None
        total = each.novelty if total is None else total + each.novelty
    return total


def class_scores(network: nn.Module, features: Tensor) -> Tensor:
    """Class scores (classes, positions) of FC2's features (D, positions)."""
    if isinstance(head := getattr(network, "head", None), Head):
        scores: Tensor = head.scores(features[None, :, :, None])
        return scores[0, :, :, 0]
    layer: Any = score_layer_of(network)
    found: Tensor = layer.weight.flatten(1) @ features + layer.bias[:, None]
    return found


@dataclass(frozen=True)
class Trained:
    """A trained classifier and what its checkpoint says of the training.

    Attributes:
        classifier: Ready to classify.
        checkpoint: Its file.
        fit_seconds: Seconds that the training took.
        val_loss: Loss on the validation fold; None where nothing was validated.
        left_out: By sense the novelties of training recordings that were left out of the
            statistics; empty where they were fitted by the layers before the scores.
    """

    classifier: SurfaceClassifier
    checkpoint: Path
    fit_seconds: float
    val_loss: float | None = None
    left_out: Mapping[str, Sequence[float]] = field(default_factory=dict)

    @classmethod
    def of(cls, classifier: SurfaceClassifier, path: Path, stored: Mapping[str, Any]) -> "Trained":
        """Join a classifier with what its checkpoint says beside it."""
        seconds, loss = stored.get("fit_seconds", 0.0), stored.get("val_loss")
        return cls(classifier, path, seconds, loss, stored.get(LEFT_OUT, {}))


def read_trained(path: str | Path, kind: str | None = None) -> Trained:
    """Read the checkpoint of a network, once; arguments and errors of ``from_checkpoint``."""
    path, stored = Path(path).expanduser(), read_checkpoint(path)
    classifier = SurfaceClassifier.from_content(path, stored)
    if kind is not None and classifier.card.kind != kind:
        raise UserError(
            f"Checkpoint {path} holds a {classifier.card.kind} network where a {kind} network "
            "is needed; give another file."
        )
    return Trained.of(classifier, path, stored)


def lightning_state(classifier: SurfaceClassifier) -> dict[str, Tensor]:
    """The state of a classifier as a checkpoint of Lightning has it; see :func:`own_state`."""
    return {f"{PREFIX}{name}": value for name, value in classifier.state_dict().items()}


def own_state(checkpoint: Mapping[str, Any]) -> dict[str, Tensor]:
    """The state of the classifier in a checkpoint of Lightning."""
    stored: dict[str, Tensor] = checkpoint["state_dict"]
    return {
        key.removeprefix(PREFIX): value for key, value in stored.items() if key.startswith(PREFIX)
    }


def _stored_statistics(state: Mapping[str, Tensor]) -> nn.ModuleDict:
    found: dict[str, dict[str, Tensor]] = {}
    for key, value in state.items():
        if key.startswith(STATISTICS):
            name, buffer = key.removeprefix(STATISTICS).rsplit(".", 1)
            found.setdefault(name, {})[buffer] = value
    return nn.ModuleDict({name: FeatureStatistics.from_state(each) for name, each in found.items()})


def _alone(part: SurfaceClassifier, fused: FusionNet) -> nn.Module:
    """The network of a single sense out of a FusionNet of it alone."""
    network = fused.networks[0]
    if fused.levels[0] == "fc3":
        return network
    whole: Any = network
    if hasattr(whole, "head"):  # whose scores FusionNet has taken out
        whole.head.scores = part.network.get_submodule("head").scores
    layer = whole.score_layer
    layer.weight.copy_(fused.head.weight.reshape(layer.weight.shape))
    layer.bias.copy_(fused.head.bias)
    return network


def content_seed(seed: int, *recordings: npt.NDArray[Any]) -> int:
    """A seed from the content of a sample: its place in a batch or list cannot matter."""
    seed &= 0xFFFFFFFF
    for array in recordings:
        seed = zlib.crc32(np.ascontiguousarray(array).data, seed)
    return seed
