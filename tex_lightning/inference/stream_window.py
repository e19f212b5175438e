"""A vote over the last seconds, which restarts on another surface and after a pause.

A fragment of HapticNet sees 2 s, so that its scores cannot follow within one. So here the samples
of the window are classified afresh with every vote, and a spectrogram that is shorter than a
fragment is repeated until it fills one: a texture goes on as it began.
"""

from collections import deque
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SenseOutput, SurfaceClassifier
from tex_lightning.classifier.vote import Vote
from tex_lightning.config import StreamConfig
from tex_lightning.errors import UserError
from tex_lightning.senses.features.spectrogram import SETTLING_SECONDS
from tex_lightning.senses.signal import SignalSense

STEP_SECONDS = 0.1  # between votes
LEAST = 3  # steps that vote
RECENT = 7  # steps that may contradict the vote before them; chosen on recordings of lmt16
CONFIRMED = 2  # contradictions in succession that are another surface
SILENT = 3  # steps below the least level that are a pause; a stroke turns round more quickly
SETTLING = round(SETTLING_SECONDS / STEP_SECONDS)  # steps to steady movement, after that of a touch

Slice = Mapping[str, Tensor]  # samples (axes, samples) of one step, by modality


class WindowVote:
    """Vote over the last ``stream.window`` seconds, once every 0.1 s of signal.

    Args:
        classifier: Accelerated; it is copied.
        fixed: By sense what is said of a photo, which stays as it is.
        config: ``window``, ``odds`` and ``contact``.

    Attributes:
        contact: Whether something is touched.
        changed_at: Where in the signal, in seconds, the last touch after a pause was, or the next
            surface is taken to begin; None if there was neither.
        slices: The steps that vote.
    """

    waiting = False  # what is no whole step yet is not worth a vote

    def __init__(
        self, classifier: SurfaceClassifier, fixed: Mapping[str, SenseOutput], config: StreamConfig
    ) -> None:
        if config.window is None:
            raise ValueError("stream.window is None, which is for WholeVote")
        self.classifier, self.fixed, self.odds = deepcopy(classifier), fixed, config.odds
        self.senses: dict[str, SignalSense] = {
            name: sense
            for name, sense in self.classifier.senses.items()
            if isinstance(sense, SignalSense)
        }
        self.settling = SETTLING if self._stop_skipping() else 0
        self.rates = {each.modality: each.decoder.sampling_rate for each in self.senses.values()}
        ranges = classifier.card.input_ranges
        self.least = {
            modality: config.contact * ranges.get(modality, {}).get("level", [0.0])[0]
            for modality in self.rates
        }
        self.slices: deque[Slice] = deque(maxlen=round(config.window / STEP_SECONDS))
        self.pending: dict[str, Tensor] = {}  # samples that are no whole step yet
        self.steps = self.silent = self.unsettled = 0
        self.contact = False
        self.changed_at: float | None = None
        self.failure: UserError | None = None  # why there was no vote yet
        self.voted = False
        self.signs = 0
        self.vote: Vote | None = None
        self._begin_anew()

    def _stop_skipping(self) -> bool:
        """Let features take all samples; whether they skipped what precedes steady movement."""
        skipping: list[Any] = [
            sense.features
            for sense in self.senses.values()
            if getattr(sense.features, "skip_impact", False)
        ]
        for features in skipping:
            features.skip_impact = False  # the steps of a touch are left out instead
        return bool(skipping)

    def push(self, chunks: Slice) -> Vote | None:
        """Take samples (axes, samples) by modality; the vote after the last whole step."""
        self.pending = {
            modality: torch.cat((self.pending[modality], chunk), dim=1) if self.pending else chunk
            for modality, chunk in chunks.items()
        }
        while all(each.shape[1] >= self._length(name) for name, each in self.pending.items()):
            sizes = {name: self._length(name) for name in self.pending}
            self._step({name: each[:, : sizes[name]] for name, each in self.pending.items()})
            self.pending = {name: each[:, sizes[name] :] for name, each in self.pending.items()}
        self.pending = {name: each.clone() for name, each in self.pending.items()}
        self._check_in_step()
        return self.vote

    def finish(self) -> Vote | None:
        """The last vote."""
        return self.vote

    def check(self) -> None:
        """Make sure that a surface that was touched could be voted on.

        Raises:
            UserError: Saying what prevented it.
        """
        if self.failure is not None and not self.voted:
            raise self.failure
        if self.steps < LEAST:
            raise UserError(
                f"The stream ended within {LEAST * STEP_SECONDS:g} s, too soon for a vote; send "
                "more signal."
            )

    @property
    def levels(self) -> dict[str, float]:
        """Root mean square of the samples that vote, by modality; empty if none do."""
        return {name: _level(self._joined(self.slices)[name]) for name in self.rates if self.slices}

    def _length(self, modality: str) -> int:
        """Samples of the next step."""
        size = STEP_SECONDS * self.rates[modality]
        return round((self.steps + 1) * size) - round(self.steps * size)

    def _check_in_step(self) -> None:
        """Bound what waits for another sense."""
        for modality, samples in self.pending.items():
            if samples.shape[1] > self.rates[modality] + self._length(modality):
                raise UserError(
                    f"The stream has more than a second of {modality} that the other signals lack; "
                    "push chunks of the same duration."
                )

    def _step(self, samples: Slice) -> None:
        """Look for contact, vote, look for another surface."""
        self.steps += 1
        if not self._touching(samples):
            return
        if self.unsettled:
            self.unsettled -= 1
            return
        if self.silent:  # perhaps a pause
            return
        self.slices.append({name: each.clone() for name, each in samples.items()})
        if len(self.slices) >= LEAST:
            self.vote = self._vote(self.slices)
        if self._is_another():
            self._begin_anew(RECENT)
            self.changed_at = round((self.steps - RECENT) * STEP_SECONDS, 6)
        self.labels.append(None if self.vote is None else self.vote.label)

    def _touching(self, samples: Slice) -> bool:
        """Whether the tool is on a surface: a pause is several steps, a touch is one."""
        loud = all(_level(each) > self.least[name] for name, each in samples.items())
        self.silent = 0 if loud else self.silent + 1
        if self.contact and self.silent >= SILENT:
            self.contact = False
            self._begin_anew()
        elif not self.contact and loud:
            self.contact = True
            if self.steps > 1:  # else it moved already
                self.changed_at = round((self.steps - 1) * STEP_SECONDS, 6)
                self.unsettled = self.settling + 1 if self.settling else 0
        return self.contact

    def _is_another(self) -> bool:
        """Whether the last steps have contradicted the vote before them for long enough."""
        before = self.labels[0] if len(self.labels) == RECENT else None
        if self.odds is None or before is None:
            return False
        recent = self._vote(list(self.slices)[-RECENT:])
        contradicted = (
            recent is not None
            and recent.label != before
            and (recent.probability >= self.odds * float(recent.probabilities[before]))
        )
        self.signs = self.signs + 1 if contradicted else 0
        return self.signs >= CONFIRMED

    def _begin_anew(self, kept: int = 0) -> None:
        """Leave so many of the last steps, and vote over them alone."""
        while len(self.slices) > kept:
            self.slices.popleft()
        self.labels: deque[int | None] = deque(maxlen=RECENT)  # of the votes before, oldest first
        self.signs = 0
        self.vote = self._vote(self.slices) if kept else None

    @torch.inference_mode()
    def _vote(self, slices: Sequence[Slice]) -> Vote | None:
        """Vote over some steps; None if they are too little for these features."""
        whole, recordings = self.classifier, self._joined(slices)
        try:
            live = {name: self._sense(name, recordings) for name in self.senses}
        except UserError as error:
            self.failure = error
            return None
        self.voted = True
        return whole.vote({**self.fixed, **live}, whole.card.decision["seed"])

    def _sense(self, name: str, recordings: Slice) -> SenseOutput:
        """What a live sense says of an input that is repeated to the size of a fragment."""
        sense, level = self.senses[name], self.classifier.embedding_layer(name)
        recording = recordings[sense.modality]
        if sense.geometry is None:
            return self.classifier.sense_output(name, recording)
        x = sense.dense_input(recording)
        frames = max(x.shape[-1], sense.window_size[1])
        x = x[..., torch.arange(frames, device=x.device) % x.shape[-1]]
        return self.classifier.output_of(name, sense.dense(x, level))

    def _joined(self, slices: Sequence[Slice]) -> dict[str, Tensor]:
        """The samples of some steps (axes, samples), by modality."""
        return {name: torch.cat([each[name] for each in slices], dim=1) for name in self.rates}


def _level(samples: Tensor) -> float:
    """As :attr:`.TraceMonitor.level`: of all axes together, each without its mean."""
    return float(samples.double().var(dim=1, correction=0).sum().sqrt())
