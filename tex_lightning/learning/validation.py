"""Classify the validation samples of an epoch, and decide on many of them at once."""

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.core.devices import room, to_cpu
from tex_lightning.inference.engine import accelerate

MAX_UNDECIDED = 1 << 24  # scores that wait for their decision, 64 MB in float32
MAX_INPUTS = 1 << 28  # bytes of the network inputs that are kept on the CPU


class Validation:
    """Class scores of the validation samples, and decisions on many samples at a time.

    Votes are counted on the CPU. Scores are copied there for many samples together, since each copy
    from another device makes the CPU wait.

    Args:
        engine: Settings of the accelerated copy that computes the scores; None uses none.
    """

    def __init__(self, engine: EngineConfig | None = None) -> None:
        self.engine = engine
        self.inputs: dict[tuple[str, int], Tensor] = {}  # by sense and number of the sample
        self.bytes = 0

    def begin(self, classifier: SurfaceClassifier) -> None:
        """Begin an epoch with the weights that a classifier has now."""
        earlier = getattr(self, "fast", None)  # takes these weights
        engine = self.engine
        self.fast = classifier if engine is None else accelerate(classifier, engine, earlier)
        self.scores: list[Tensor] = []
        self.labels: list[Tensor] = []
        self.waiting = 0

    def add(self, recordings: Mapping[str, Tensor], label: Tensor, number: int) -> Tensor:
        """Return the class scores (classes, fragments) of a sample, and keep them.

        Args:
            recordings: Decoded, by modality.
            label: () true class, on the CPU.
            number: Number of the sample.
        """
        partials = []
        for name, sense in self.fast.senses.items():
            x = self._input(name, recordings[sense.modality], number)
            embedding = self.fast.embedding_of_input(name, x)
            partials.append(self.fast.output_of(name, embedding).partial_logits)
        scores = self.fast.fuse(partials, self.fast.seed(**recordings))
        self.scores.append(scores.detach())
        self.labels.append(label)
        self.waiting += scores.numel()
        return scores

    def _input(self, name: str, recording: Tensor, number: int) -> Tensor:
        """Return the input of a recording, on the device; that of a signal is computed once.

        Training changes no features of this package, and its networks do not write to their input.
        Pixels of a photo are kept on another device than the CPU, which reads them from the cache.
        """
        if (name, number) in self.inputs:
            return self.inputs[name, number]
        sense, device = self.fast.senses[name], self.fast.device
        x = sense.dense_input(recording).to(device)
        near = device.type == "cpu"
        most = MAX_INPUTS if near else room(device)
        kept = sense.is_builtin and not (near and sense.medium == "photo")
        if kept and self.bytes + x.nbytes <= most:
            self.inputs[name, number] = x
            self.bytes += x.nbytes
        return x

    @property
    def is_full(self) -> bool:
        """Whether the scores that wait for a decision have reached their limit of memory."""
        return self.waiting >= MAX_UNDECIDED

    def decide(self) -> tuple[Tensor, Tensor]:
        """Decide on all samples whose scores wait.

        Returns:
            Predicted and true classes of fragments (2, fragments) and of samples (2, samples), on
            the device of the scores.
        """
        device, fragments, samples = self.scores[0].device, [], []
        for scores, label in zip(to_cpu(self.scores), self.labels, strict=True):
            vote = self.fast.decide(_finite(scores, label), self.fast.card.temperature)
            fragments.append(torch.stack([vote.fragments, label.expand_as(vote.fragments)]))
            samples.append(torch.stack([torch.full_like(label, vote.label), label]))
        self.scores, self.labels, self.waiting = [], [], 0
        return torch.cat(fragments, dim=1).to(device), torch.stack(samples, dim=1).to(device)


def _finite(scores: Tensor, label: Tensor) -> Tensor:
    """Return the scores (classes, fragments); if they are not finite, scores of a wrong label.

    So weights that diverge count as errors and do not end the training.
    """
    if bool(scores.isfinite().all()):
        return scores
    return -nn.functional.one_hot(label, len(scores))[:, None].float()
