"""A vote over everything so far, of one sense or of several."""

from collections.abc import Mapping
from dataclasses import replace

import torch
from torch import Tensor

from tex_lightning.classifier import Sensed, SurfaceClassifier
from tex_lightning.decision.voting import Vote
from tex_lightning.errors import UserError
from tex_lightning.inference.streaming.classifier import StreamingClassifier


class WholeVote:
    """Vote over the whole recording so far, no sample computed twice.

    Args:
        classifier: Accelerated; a :class:`StreamingClassifier` takes each of its live senses.
        fixed: By sense what is said of a photo, which stays as it is.
        wait: See :class:`StreamingClassifier`.

    Attributes:
        contact: Whether something is touched; None: it is not looked at.
        changed_at: When the vote began anew, in seconds; None: it never does.

    Raises:
        UserError: If a sense cannot be streamed, or samples of several were to wait.
    """

    contact: bool | None = None
    changed_at: float | None = None

    def __init__(
        self, classifier: SurfaceClassifier, fixed: Mapping[str, Sensed], wait: float
    ) -> None:
        self.classifier, self.fixed = classifier, fixed
        # scores of fragments are kept where they are joined or averaged, else votes alone
        self.counted = len(classifier.card.senses) == 1 and classifier.card.rule != "score"
        if wait > 0 and not self.counted:
            raise UserError(
                "stream.wait is for a single sense that decides by decision.rule=vote or mean, and "
                "this is none: set stream.wait=0."
            )
        self.streams = {
            name: StreamingClassifier(
                classifier.part([name]), wait=wait, keep_scores=not self.counted
            )
            for name in classifier.card.senses
            if name not in fixed
        }

    @property
    def waiting(self) -> bool:
        """Whether samples were left uncomputed, which :meth:`finish` computes."""
        return any(stream.waiting is not None for stream in self.streams.values())

    def push(self, chunks: Mapping[str, Tensor]) -> Vote | None:
        """Take samples (axes, samples) by modality and vote over all so far."""
        for stream in self.streams.values():
            if stream.branch.modality in chunks:
                stream.push(chunks[stream.branch.modality])
        return self._vote()

    def finish(self) -> Vote | None:
        """Compute what waits."""
        for stream in self.streams.values():
            stream.finish()
        return self._vote()

    def check(self) -> None:
        """Make sure that every sense had a fragment.

        Raises:
            UserError: Saying how much signal it takes.
        """
        for stream in self.streams.values():
            stream.branch.check_frames(stream.frames)

    @torch.inference_mode()
    def _vote(self) -> Vote | None:
        """Of several senses over random tuples of their fragments, of the same seed every time."""
        if any(stream.vote is None for stream in self.streams.values()):
            return None
        if self.counted:
            return self._counted()
        whole = self.classifier
        streams = self.streams.items()
        live = {name: Sensed(self._summand(name), each.novelty) for name, each in streams}
        return whole.vote({**self.fixed, **live}, whole.card.decision["seed"])

    def _counted(self) -> Vote | None:
        (stream,) = self.streams.values()
        if stream.vote is None or stream.novelty is None:
            return stream.vote
        return replace(stream.vote, novelty=float(stream.novelty))

    def _summand(self, name: str) -> Tensor:
        """What a live sense adds: a part that is fused on FC2 has its summand as scores."""
        scores = self.streams[name].scores
        own = self.classifier.level(name) == "fc2"
        return scores if own else self.classifier.project(name, scores)
