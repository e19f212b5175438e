"""The classifier: decoders, features, networks and decision rule in one module.

A checkpoint holds its weights and its :class:`Card`, the plain values from which it is built again.
So a prediction decodes, computes and decides exactly as the test after the training did.

The way of a sample through :meth:`SurfaceClassifier.classify`: each sense maps its recording to an
embedding (D, positions) and then to partial logits (classes, positions); :meth:`fuse` adds those of
all senses to class scores (classes, fragments); :meth:`decide` makes the label of them.
"""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, cast

import torch
from torch import Tensor, nn

from tex_lightning.classifier.card import Card
from tex_lightning.classifier.checkpoint import (
    classifier_state,
    lightning_state,
    parts_below,
    read_checkpoint,
    reading,
)
from tex_lightning.classifier.statistics import FeatureStatistics, TrainingRows
from tex_lightning.classifier.vote import RULES, Vote, random_tuples
from tex_lightning.config.model import FUSION
from tex_lightning.core.devices import computing_threads
from tex_lightning.core.files import write_atomically
from tex_lightning.data.recordings import Recording
from tex_lightning.errors import UserError
from tex_lightning.networks.archives import SizeLimit, check_weights
from tex_lightning.networks.blocks import Level, score_layer_of, shared_copy
from tex_lightning.networks.fusionnet import FusionLayer, bounded, scored_by
from tex_lightning.networks.line import scores_from_fc2
from tex_lightning.senses.base import Sense, content
from tex_lightning.senses.making import make_sense
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.samples import content_seed

STATISTICS, ROWS = "statistics.", "rows."  # in its own
ONE_THREAD = 60_000_000_000  # weights times samples or pixels: about 200 million products


class SenseOutput(NamedTuple):
    """Scores and novelty of one recording by one sense.

    Attributes:
        partial_logits: (classes, positions) that it adds to the class scores.
        novelty: () how unlike the training its mean features are; None if not known.
    """

    partial_logits: Tensor
    novelty: Tensor | None


class SurfaceClassifier(nn.Module):
    """Classify decoded recordings by all of their fragments; it is a :class:`.Decider`.

    The class scores of several senses are added (FusionNet). If their networks were fitted in
    closed form, the scores of a sense are scaled down for a recording that is far from its
    training recordings (:meth:`is_weighted`).

    Args:
        card: Card of the classifier.
        senses: Existing senses of the card; None makes them, with random weights.
        fusion: Existing fusion layer of several senses; None makes it, with random weights, and
            removes the score layers that it replaces.

    Attributes:
        card: Plain values from which the classifier was built.
        senses: The :class:`~tex_lightning.senses.base.Sense` of every name, a ``ModuleDict``.
        fusion: The layer that adds up the scores of several senses; None for a single one.
        statistics: By the name of the sense, the
            :class:`~tex_lightning.classifier.statistics.FeatureStatistics` of the embeddings
            (:meth:`embedding`) of the training recordings; empty before training has ended, and for
            a checkpoint without them.
        rows: By the name of the sense, the
            :class:`~tex_lightning.classifier.statistics.TrainingRows` of a network in closed
            form that keeps them.
        trained_embeddings: By the name of the sense, the training recordings and their mean
            embeddings (recordings, D). Set by a training, and not kept in a checkpoint.

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

    senses: Mapping[str, Sense]
    fusion: FusionLayer | None
    statistics: nn.ModuleDict
    rows: nn.ModuleDict

    def __init__(
        self, card: Card, senses: dict[str, Sense] | None = None, fusion: FusionLayer | None = None
    ) -> None:
        super().__init__()
        self.card = card
        if senses is None:
            senses = {}
            for name, node in card.senses.items():
                senses[name] = make_sense(name, node, len(card.classes))
        self.senses = cast(Mapping[str, Sense], nn.ModuleDict(senses))
        self.fusion = fusion
        if card.kind == FUSION and fusion is None:
            networks = [sense.network for sense in senses.values()]
            self.fusion = FusionLayer(*networks, classes=len(card.classes), **card.fusion)
            self.fusion.remove_scores(networks)
        self.statistics, self.rows = nn.ModuleDict(), nn.ModuleDict()
        self.trained_embeddings: dict[str, tuple[Sequence[Recording], Tensor]] = {}

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
        path = expanded(path)
        classifier = cls.from_content(path, read_checkpoint(path))
        if kind is not None and classifier.card.kind != kind:
            raise UserError(
                f"Checkpoint {path} holds a {classifier.card.kind} network where a {kind} network "
                "is needed; give another file."
            )
        return classifier

    @classmethod
    def from_content(cls, path: Path, stored: dict[str, Any]) -> "SurfaceClassifier":
        """Build the classifier of a checkpoint, ready to classify on the CPU.

        Args:
            path: The file, for messages.
            stored: Result of :func:`~tex_lightning.classifier.checkpoint.read_checkpoint`.

        Raises:
            UserError: If :meth:`from_checkpoint` fails.
        """
        with reading(path):
            card = Card.from_dict(stored["hyper_parameters"]["card"])
            if card.baseline:
                raise UserError(
                    f"Checkpoint {path} holds {card.title}, and this needs one of this package's "
                    "networks; give another file."
                )
            with SizeLimit(path.stat().st_size):
                classifier = cls(card)
            state = classifier_state(stored)
            classifier.expect(state)
            check_weights(state)
            known = classifier.state_dict()  # statistics have what earlier checkpoints lack
            completed = {name: x for name, x in known.items() if name.startswith(STATISTICS)}
            classifier.load_state_dict(completed | state)
        return classifier.eval()

    def save(self, path: Path) -> None:
        """Write a checkpoint of tensors and plain values."""
        card = {"hyper_parameters": {"card": self.card.to_dict()}}
        content = {**card, **self.weights()}
        write_atomically(path, lambda partial: torch.save(content, partial))

    def weights(self) -> dict[str, Any]:
        """Return the trained part of a checkpoint."""
        return {"state_dict": lightning_state(self)}

    def expect(self, stored: Mapping[str, Tensor]) -> None:
        """Make room for statistics and rows of the sizes in a stored state."""
        statistics = parts_below(STATISTICS, stored).items()
        self.statistics = nn.ModuleDict({x: FeatureStatistics.from_state(y) for x, y in statistics})
        rows = parts_below(ROWS, stored).items()
        self.rows = nn.ModuleDict({name: TrainingRows.from_state(state) for name, state in rows})

    @property
    def network(self) -> nn.Module:
        """The network of a single sense."""
        (sense,) = self.senses.values()
        return sense.network

    @property
    def device(self) -> torch.device:
        """Device of its parameters."""
        return next(iter(self.senses.values())).device

    def trained_modules(self) -> list[nn.Module]:
        """Return the networks of all senses and the fusion layer."""
        networks = [sense.network for sense in self.senses.values()]
        return networks if self.fusion is None else [*networks, self.fusion]

    def count_parameters(self) -> int:
        """Count the trained parameters."""
        return sum(x.numel() for part in self.trained_modules() for x in part.parameters())

    @torch.inference_mode()
    def classify(self, **recordings: Tensor) -> Vote:
        """Decide on one sample; arguments are those of :meth:`logits`."""
        outputs = self.sense_outputs(**recordings)
        with computing_threads(1):
            return self.vote(outputs, self.seed(**recordings))

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
        return self.fuse(partials, self.seed(**recordings))

    def sense_outputs(self, **recordings: Tensor) -> dict[str, SenseOutput]:
        """Compute scores and novelty by every sense; arguments are those of :meth:`logits`."""
        self.require(recordings)
        senses = self.senses.items()
        return {name: self.sense_output(name, recordings[sense.modality]) for name, sense in senses}

    def sense_output(self, name: str, recording: Tensor) -> SenseOutput:
        """Compute scores and novelty of a decoded recording by one sense, in one pass."""
        with computing_threads(self.threads(name, recording)):
            return self.output_of(name, self.embedding(name, recording))

    def threads(self, name: str, recording: Tensor) -> int | None:
        """Return 1 if a recording is too small to be computed faster by several threads.

        The arithmetic is estimated as the number of weights times that of samples or pixels.
        """
        weights = sum(values.numel() for values in self.senses[name].network.parameters())
        places = recording.numel() // max(1, min(recording.shape))
        little = 0 < weights * places < ONE_THREAD
        return 1 if little and self.device.type == "cpu" else None

    def output_of(self, name: str, features: Tensor) -> SenseOutput:
        """Compute scores and novelty from features (D, positions), see :meth:`embedding`."""
        statistics = self.statistics_of(name)
        novelty = None if statistics is None else statistics.novelty(features.mean(dim=1))
        weighted = self.is_weighted(name)
        return SenseOutput(self.partial_logits_of(name, features, weighted=weighted), novelty)

    def statistics_of(self, name: str) -> FeatureStatistics | None:
        """Return the class statistics of one sense; None of a checkpoint without them."""
        return cast(FeatureStatistics | None, dict(self.statistics.items()).get(name))

    def vote(self, outputs: Mapping[str, SenseOutput], seed: int) -> Vote:
        """Decide by the scores of all senses; ``seed`` is that of the tuples."""
        logits = self.fuse([outputs[name].partial_logits for name in self.senses], seed)
        vote, novelty = self.decide(logits, self.card.temperature), join_novelties(outputs.values())
        return vote if novelty is None else vote.with_novelty(novelty)

    def seed(self, **recordings: Tensor) -> int:
        """Return the seed of the random choices for one sample; 0 for a single sense."""
        if self.fusion is None:
            return 0
        arrays = (content(recordings[modality]) for modality in self.card.modalities)
        return content_seed(self.card.decision["seed"], *arrays)

    def partial_logits(self, name: str, recording: Tensor) -> Tensor:
        """Return what a sense adds to the class scores of a recording: (classes, positions)."""
        embedding = self.embedding(name, recording)
        return self.partial_logits_of(name, embedding, weighted=self.is_weighted(name))

    def partial_logits_of(self, name: str, embedding: Tensor, *, weighted: bool) -> Tensor:
        """Return the partial logits (classes, positions) of an embedding (D, positions).

        :meth:`is_weighted`, which depends on values of the statistics, says whether they are
        ``weighted``; a graph that is traced has to know it before.
        """
        scored = self.embedding_layer(name) != self.fused_layer(name)
        features = scores_from_fc2(self.senses[name].network, embedding) if scored else embedding
        partial_logits = self.project(name, features)
        if not weighted:
            return partial_logits
        statistics = cast(FeatureStatistics, self.statistics_of(name))
        share = statistics.reliability(embedding.mean(dim=1))
        return share * bounded(partial_logits, statistics.error)

    def is_weighted(self, name: str) -> bool:
        """Return whether the scores of a sense are scaled by the reliability of its recording."""
        statistics = self.statistics_of(name)
        return self.fusion is not None and statistics is not None and statistics.has_reach

    def embedding(self, name: str, recording: Tensor) -> Tensor:
        """Compute the features (D, positions) of one sense, which :attr:`statistics` describe.

        They are those of FC2, whatever layer is fused. A network without a ``score_layer`` has no
        such layer; its class scores take their place.
        """
        return self.senses[name].positions(recording, self.embedding_layer(name))

    def embedding_of_input(self, name: str, x: Tensor) -> Tensor:
        """Compute the :meth:`embedding` (D, positions) of an input of one sense's network."""
        return self.senses[name].dense_grid(x, self.embedding_layer(name)).flatten(1)

    def fragment_scores(self, name: str, recording: Tensor) -> Tensor:
        """Return the scores (classes, rows, columns) that one sense alone gives each position.

        A signal has one row; ``recording`` is decoded.
        """
        sense = self.senses[name]
        grid = sense.dense_grid(sense.dense_input(recording), self.embedding_layer(name))
        scores = self.output_of(name, grid.flatten(1)).partial_logits
        return scores.reshape(-1, *grid.shape[1:])

    def embedding_layer(self, name: str) -> Level:
        """Return the layer whose output is the :meth:`embedding` of a sense."""
        level = self.fused_layer(name)
        has_scores = level == "fc3" and score_layer_of(self.senses[name].network) is not None
        return "fc2" if has_scores else level

    def fused_layer(self, name: str) -> Level:
        """Return the layer of a sense that is fused; of a single sense the layer of its scores."""
        return "fc3" if self.fusion is None else self.fusion.levels[self._index(name)]

    def _index(self, name: str) -> int:
        return self.card.sense_names.index(name)

    def project(self, name: str, features: Tensor) -> Tensor:
        """Return the partial logits of one sense from its features (D, positions)."""
        if self.fusion is None:
            return features
        return self.fusion.project(self._index(name), features[None])[0]

    def fuse(self, partials: Sequence[Tensor], seed: int) -> Tensor:
        """Return the class scores (classes, fragments) of one sample.

        Args:
            partials: Partial logits by sense, in order; those of a single sense are the scores.
            seed: Seed of the tuples; see :func:`~tex_lightning_runtime.samples.content_seed`.
        """
        if self.fusion is None or len(partials) == 1:
            return partials[0]
        positions = [partial.shape[-1] for partial in partials]
        tuples = random_tuples(positions, self.card.decision["pairs"], seed)
        parts = [partial[None] for partial in partials]
        return self.fusion.fuse(parts, tuples.to(partials[0].device))[0]

    @torch.no_grad()
    def with_senses(self, senses: Sequence[str]) -> "SurfaceClassifier":
        """Return a classifier that uses some of the senses, for samples that lack the others.

        It shares features, networks and statistics with this one. If FC2 is fused, a single sense
        gets its columns of the fusion layer as its score layer. If FC3 is fused, it keeps its own.
        """
        if self.fusion is None or tuple(senses) == self.card.sense_names:
            return self
        chosen = {name: self.senses[name] for name in senses}
        layer = self.fusion.of([self._index(name) for name in senses])
        if len(senses) == 1 and layer.levels[0] == "fc2":
            ((name, sense),) = chosen.items()
            network = scored_by(sense.network, layer.head).train(sense.training)
            chosen[name] = shared_copy(sense, network=network)
        fusion = layer if len(senses) > 1 else None
        part = SurfaceClassifier(self.card.of(senses), chosen, fusion)
        for name in senses:
            if name in self.statistics:
                part.statistics[name] = self.statistics[name]
        return part.train(self.training)

    def require(self, available: Sequence[str] | dict[str, Any]) -> None:
        """Reject a sample that lacks a modality.

        Raises:
            UserError: Naming it.
        """
        needs = self.card.modalities
        if absent := [modality for modality in needs if modality not in available]:
            raise UserError(
                f"This {self.card.kind} network needs {' and '.join(needs)}; give "
                f"{' and '.join(f'{key}=FILE' for key in absent)} too."
            )


def join_novelties(outputs: Iterable[SenseOutput]) -> Tensor | None:
    """Return the novelty of a sample: the sum over its senses; None if it is not known of all."""
    known: list[Tensor] = []
    for output in outputs:
        if output.novelty is None:
            return None
        known.append(output.novelty)
    return sum(known, torch.zeros_like(known[0]))
