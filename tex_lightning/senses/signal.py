"""The sense whose recordings are signals: traces of acceleration, sounds, forces."""

import inspect
import logging
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any, ClassVar, cast

import numpy as np
import torch
from torch import Tensor

from tex_lightning.core.console import log_once
from tex_lightning.core.devices import is_at_hand
from tex_lightning.core.progress import track
from tex_lightning.data.banks import Bank, Indices, InputBank
from tex_lightning.data.decode import Array, SignalDecoder
from tex_lightning.data.recordings import Recording, plural
from tex_lightning.data.store import LazyRecordings, Store, load_recording
from tex_lightning.errors import UserError
from tex_lightning.networks.linear import LinearNet
from tex_lightning.perturbations.pixels import Scene
from tex_lightning.perturbations.table import Augmentation
from tex_lightning.perturbations.traces import disturbed
from tex_lightning.senses.base import Augment, Sense, as_tensor
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning.senses.features.spectrogram import SpectrogramFeatures
from tex_lightning.senses.sensor_augmentation import SensorAugmentation, draw_changes
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.quality import (
    Quality,
    Ranges,
    level,
    limits,
    trace_measures,
    trace_quality,
)
from tex_lightning_runtime.resampling import to_rate
from tex_lightning_runtime.samples import Channels, as_trace

log = logging.getLogger(__name__)
EXAMPLE_SECONDS = 4
PIECES = (1 / 4, 1 / 16)  # of a recording, for scores of short ones
MAX_CUT = 600  # recordings of which there are pieces, or a few more: one of each class at least
EACH_DISTURBED, MAX_DISTURBED = 3, 120  # times a recording is disturbed at most, and in all
MAX_SECONDS = 10  # of a recording that is disturbed


class SignalSense(Sense):
    """Signals (axes, samples) float32; features map one to (1, ..., frames), time last.

    Features that have ``magnitudes``, ``fit`` and ``normalise``, as spectrograms, learn their
    normalisation from the training set; those that have ``learn`` see the training signals first.
    """

    medium: ClassVar[str] = "signal"
    dimensions: ClassVar[int] = 2
    decoder: SignalDecoder

    @classmethod
    def make_decoder(cls, decode: Mapping[str, Any]) -> SignalDecoder:
        """Make the decoder; files without a rate have the one that all are brought to."""
        rate, given = decode["sampling_rate"], decode.get("file_rate")
        channels, unit = decode.get("channels"), decode.get("time_unit")
        chosen = None if channels is None else tuple(channels)
        return SignalDecoder(rate, given or rate, chosen, unit, assumes=given is None)

    @property
    def spectrogram(self) -> SpectrogramFeatures | None:
        """The features, if they are a spectrogram."""
        return self.features if isinstance(self.features, SpectrogramFeatures) else None

    @property
    def tells_input_size(self) -> bool:
        """Whether the features are a spectrogram or a baseline's, whose length can be counted."""
        return self.spectrogram is not None or hasattr(self.features, "counts_samples")

    def check(self, recording: Tensor | Array) -> None:
        """Reject a decoded recording that is too short; see the base class."""
        if isinstance(self.features, BandProportions) and isinstance(self.network, LinearNet):
            self.features.checked(as_tensor(recording))  # whatever has features has scores
        else:
            super().check(recording)

    def check_input(self, height: int, width: int) -> None:
        """Reject a spectrogram that is too short for one fragment; see the base class."""
        least, features = self.min_size[1], self.features
        if width < least and isinstance(features, SpectrogramFeatures):
            rate = features.sampling_rate
            have = max(0, features.samples(width)) / rate if width else 0.0
            raise UserError(
                f"The {self.noun} has {have:.2f} s of movement, and {self.title} needs "
                f"{features.samples(least) / rate:.2f} s for one fragment; record longer "
                "strokes, or train with experiment=few/haptic, which takes shorter ones."
            )

    def input_size(self, recording: Tensor | Array) -> tuple[int, int]:
        """Return bands and frames of the spectrogram, which is not computed for that."""
        recording = as_tensor(recording)
        if self.spectrogram is None:
            height, width = self(recording).shape[-2:]
            return height, width
        return self.spectrogram.bands, self.spectrogram.count_frames(recording)

    def blank(self, height: int, width: int) -> Tensor:
        """Return a spectrogram of zeros."""
        return torch.zeros(1, 1, height, width)

    def example(self) -> Tensor:
        """Make a blank spectrogram, or what other features give for some seconds of noise."""
        if self.spectrogram is not None:
            return self.blank(self.spectrogram.bands, 1)
        noise = torch.randn(1, EXAMPLE_SECONDS * round(self.decoder.sampling_rate))
        return self.compute_features(noise)

    def bank(
        self,
        rows: Sequence[Recording],
        store: Store,
        fit: Mapping[str, Any],
        *,
        size: int,
        seed: int,
        learn: bool,
    ) -> InputBank:
        """Return the inputs of all recordings, then of perturbed copies; see the base class.

        The normalisation is that of the clean ones.
        """
        features: Any = self.features
        if learn and hasattr(features, "learn"):
            signals = LazyRecordings(rows, lambda row: load_recording(row, store).to(self.device))
            features.learn(signals)
        clean = (self._raw(load_recording(row, store)) for row in self._tracked(rows))
        perturbed = self._perturbed(rows, store, fit, seed)
        raw = InputBank(chain(clean, perturbed), 1).inputs
        if learn and hasattr(features, "fit"):
            features.fit(raw[: len(rows)])
        versions, share, draw = len(raw) // len(rows), fit["sensor_augmentation"], None
        if share and self.spectrogram is not None and self.spectrogram.standardises:
            axes = len(load_recording(rows[0], store))
            self.sensor_augmentation = SensorAugmentation(self.spectrogram, size, axes)
            draw = partial(draw_changes, share, size)
        bank = InputBank(map(self._normalised, raw), size, versions, draw)
        takes = _arguments_of_fit(self.network)
        if "pieces" in takes and getattr(self.network, "cuts", True):
            bank.pieces = [*self._pieces(rows, store, seed)]
        if "disturbed" in takes:
            bank.disturbed = [*self._disturbed(rows, store, seed, raw)]
        return bank

    def _pieces(
        self, rows: Sequence[Recording], store: Store, seed: int
    ) -> Iterator[tuple[int, Tensor]]:
        """Yield numbers of some recordings, of every class, and inputs of short pieces of them."""
        step, seen = math.ceil(len(rows) / MAX_CUT), Counter[str]()
        for number, row in enumerate(rows):
            seen[row.label] += 1
            if seen[row.label] % step != 1 % step:
                continue
            recording, rng = load_recording(row, store), np.random.default_rng([seed, number])
            for part in PIECES:
                length = math.ceil(part * recording.shape[-1])
                start = int(rng.integers(recording.shape[-1] - length + 1))
                # hardly anything moves in it, or features of one's own cannot take one as short
                with suppress(UserError, RuntimeError, ValueError):
                    piece = self._raw(recording[:, start : start + length])
                    yield number, self._normalised(piece)

    def _disturbed(
        self, rows: Sequence[Recording], store: Store, seed: int, raw: Sequence[Tensor]
    ) -> Iterator[tuple[Tensor, Tensor]]:
        """Yield inputs of stretches of some recordings, and of the same disturbed.

        Recordings are evenly spread, and so are the kinds of disturbance. ``raw`` are the features
        of whole recordings, before normalisation.
        """
        rate = self.decoder.sampling_rate
        count, most = min(MAX_DISTURBED, EACH_DISTURBED * len(rows)), round(MAX_SECONDS * rate)
        for number in range(count):
            rng = np.random.default_rng([seed, 1, number])  # pieces have [seed, number]
            index = number * len(rows) // count
            recording = load_recording(rows[index], store)
            start = int(rng.integers(max(0, recording.shape[-1] - most) + 1))
            stretch = recording[:, start : start + most]
            changed = torch.from_numpy(disturbed(stretch.numpy(), number, Scene(rng, rate)))
            with suppress(UserError, RuntimeError, ValueError):  # as of pieces
                whole = stretch.shape == recording.shape
                before = raw[index] if whole else self._raw(stretch)
                yield self._normalised(before), self._normalised(self._raw(changed))

    @torch.no_grad()
    def _raw(self, recording: Tensor) -> Tensor:
        """Return features (..., frames), before normalisation if that is apart."""
        features: Any = self.features
        recording = recording.to(self.device)
        if not hasattr(features, "magnitudes"):
            return self.compute_features(recording)[0]
        magnitudes: Tensor = features.magnitudes(recording)
        return magnitudes

    def _normalised(self, raw: Tensor) -> Tensor:
        """Return the network input (..., frames) on the CPU."""
        features: Any = self.features
        if hasattr(features, "magnitudes"):
            raw = features.normalise(raw.to(self.device))[None]
        return raw.cpu()

    def _tracked(self, rows: Sequence[Recording]) -> Iterable[Recording]:
        return track(rows, f"Features of {plural(self.modality)}")

    def _perturbed(
        self, rows: Sequence[Recording], store: Store, fit: Mapping[str, Any], seed: int
    ) -> Iterator[Tensor]:
        """Yield features of all signals perturbed; each copy and recording has its seed."""
        augmentation = Augmentation.of(fit["perturb"], rate=self.decoder.sampling_rate)
        if augmentation is None:
            return
        for copy in range(fit["perturbed_copies"]):
            for number, row in enumerate(self._tracked(rows)):
                rng = np.random.default_rng([seed, copy, number])
                changed = torch.from_numpy(augmentation(np.array(store.load(row)), rng))
                try:
                    yield self._raw(changed)
                except UserError:  # hardly anything was left of it
                    yield self._raw(load_recording(row, store))

    def training_input(
        self, pieces: Mapping[str, Tensor], size: int, augment: Augment | None = None
    ) -> Tensor:
        """Return the sub-samples, augmented where it was drawn; see the base class."""
        inputs, features = pieces["input"], self.spectrogram
        if "changes" not in pieces or features is None:
            return inputs
        changes = pieces["changes"]
        is_changed = changes.any(dim=1)
        if not is_at_hand(changes):  # where it would take a synchronisation to pick the few
            augmented = self._augmented(features, inputs, changes)
            return torch.where(is_changed[:, None, None, None], augmented, inputs)
        inputs = inputs.clone()
        inputs[is_changed] = self._augmented(features, inputs[is_changed], changes[is_changed])
        return inputs

    def _augmented(self, features: SpectrogramFeatures, inputs: Tensor, changes: Tensor) -> Tensor:
        magnitudes = features.magnitudes_of(inputs[:, 0])
        return features.normalise(self.sensor_augmentation(magnitudes, changes))[:, None]

    def decode_input(
        self,
        recording: Any,  # noqa: ANN401
        ranges: Ranges,
        *,
        rate: float | None = None,
        channels: Channels = None,
        time_unit: str | None = None,
        **_: Any,  # noqa: ANN401
    ) -> tuple[Tensor, Quality]:
        """Decode a file or samples, and say once of files that agree how they were read.

        ``rate`` in Hz is that of samples and of files without one; ``channels`` and ``time_unit``
        are other ones than the checkpoint's.
        """
        decoder = self.decoder.assuming(rate, channels, time_unit)
        if isinstance(recording, str | Path):
            path = expanded(recording)
            raw, source, reading = decoder.read(path)
            name = f"Trace {path}"
            log_once(log, f"Reads {plural(self.modality)}: {reading.said(source)}.")
            for note in reading.notes:
                log.warning("%s: %s.", path, note)
        else:
            raw, name = as_trace(recording, self.modality, decoder.channels), self.modality
            source = self.decoder.sampling_rate if rate is None else rate
        return self.resample(raw, source, ranges, name)

    def resample(
        self, raw: Array, rate: float, ranges: Ranges, name: str
    ) -> tuple[Tensor, Quality]:
        """Resample (axes, samples) at ``rate`` in Hz to the decoded rate, and check their quality.

        Raises:
            UserError: If there is no such rate, beginning with ``name``.
        """
        target = self.decoder.sampling_rate
        trace = to_rate(raw, rate, target, name)
        usual, measures = limits(ranges), trace_measures(level(trace), rate, target)
        return torch.from_numpy(trace), trace_quality(raw, usual, self.noun, measures)


def fit_closed_form(network: Any, bank: Bank, labels: Indices, groups: Sequence[str]) -> None:  # noqa: ANN401
    """Fit a network that has a method ``fit`` to all recordings and their perturbed copies.

    It gets the ``groups`` of the inputs, which of the ``recordings`` each is a version of, short
    ``pieces`` of some of them, and pairs of some and the same ``disturbed``, if it takes these.
    """
    bank = cast(InputBank, bank)
    inputs, takes = bank.inputs, _arguments_of_fit(network)
    versions = len(inputs) // len(labels)
    offered: dict[str, list[Any]] = {
        "groups": [*groups] * versions,
        "recordings": [*range(len(labels))] * versions,
        "pieces": bank.pieces,
        "disturbed": bank.disturbed,
    }
    wanted = {name: x for name, x in offered.items() if name in takes}
    network.fit(inputs, torch.from_numpy(np.resize(labels, len(inputs))), **wanted)


def _arguments_of_fit(network: Any) -> Collection[str]:  # noqa: ANN401
    """Return the names of what a network's method ``fit`` takes; none without such a method."""
    return inspect.signature(network.fit).parameters if hasattr(network, "fit") else ()
