"""Classify files and arrays with a trained checkpoint."""

import time
from collections.abc import Collection, Iterable, Mapping, Sequence, Sized
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from torch import Tensor, nn

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.classifier.card import Card
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import Config
from tex_lightning.config.check import checked_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.instantiation import trust
from tex_lightning.config.mistakes import MISTAKES, explain
from tex_lightning.core.devices import pick_device, synchronise, torch_defaults, use_tf32
from tex_lightning.core.run_folder import find_checkpoint
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.recordings import check_is_list
from tex_lightning.errors import UserError, shorten
from tex_lightning.inference.early_stopping import SequentialDecision, make_decider
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.prediction import Prediction, check_unknown, make_prediction
from tex_lightning.inference.stream import LiveStream
from tex_lightning.senses.base import Sense
from tex_lightning_runtime.quality import Quality, together

Input = str | Path | np.ndarray[Any, Any] | Tensor | list[Any] | None
Rate = float | Mapping[str, float | None] | None
TASK = "predict"
SHOWN = 5  # classes that are named


def load(path: str | Path, *overrides: str, trusted: Sequence[str] = ()) -> "Predictor":
    """Load a trained network or baseline.

    Args:
        path: A checkpoint or the run folder that holds it.
        *overrides: Arguments of ``task=predict`` on the command line, such as ``"top_k=5"``,
            ``"decision.unknown=0.05"``, ``"engine=reference"``, ``"trainer.accelerator=cpu"``.
        trusted: Packages, beside installed plugins, whose classes a checkpoint may name, in
            this process from now on; their code runs.

    Raises:
        UserError: If there is no such checkpoint, or an override is invalid.

    Example:
        >>> import tex_lightning as tl
        >>> model = tl.load("RUN", "top_k=2")
        >>> model.card.classes
        ['a', 'b', 'c']
    """
    if isinstance(trusted, str):  # else each of its letters would be trusted
        raise UserError(f"trusted is {shorten(repr(trusted))}; give a list, as in [{trusted!r}].")
    try:
        composed = compose_config([f"task={TASK}", *overrides])
    except MISTAKES as error:
        raise explain(error) from error
    composed.checkpoint = str(path)
    config = checked_config(composed)
    trust(*config.trusted, *trusted)
    with torch_defaults():  # which draws first weights
        return Predictor(load_classifier(find_checkpoint(path)), config)


class Predictor:
    """Classify files and arrays with a trained network or baseline.

    Args:
        classifier: The loaded network or baseline.
        config: The settings of ``task=predict`` and ``task=stream``.

    Attributes:
        card: The checkpoint's metadata, such as ``card.classes``.

    Example:
        >>> import numpy as np, tex_lightning as tl
        >>> model = tl.load("RUN/checkpoints/haptic.ckpt")
        >>> samples = np.random.default_rng(0).standard_normal(24_000)
        >>> model.predict(haptic=samples, rate=10_000).fragments
        4
        >>> stream = model.stream()
        >>> [stream.push(chunk).fragments for chunk in np.split(samples, 4)][-1]
        4
    """

    def __init__(self, classifier: SurfaceClassifier, config: Config) -> None:
        self.config = config
        use_tf32(config.trainer.tf32)
        self.classifier = classifier.to(pick_device(config.trainer.accelerator))
        self.card: Card = classifier.card.deciding(config.decision)
        check_unknown(self.card, bool(classifier.statistics))
        fast, senses = accelerate(self.classifier, config.engine), self.card.sense_names
        fast.card = self.card
        weighted = any(map(fast.is_weighted, senses))
        if self.card.unknown_above is None and not weighted:  # nobody asks how novel a sample is
            fast.statistics = nn.ModuleDict()
        whole = make_decider(fast, config.decision)
        # of every subset, before the first sample; all share the networks of the accelerated copy
        subsets = [some for count in range(len(senses)) for some in combinations(senses, count + 1)]
        self.deciders = {subset: whole.with_senses(subset) for subset in subsets}

    def predict(self, *, rate: Rate = None, colour: str = "rgb", **recordings: Input) -> Prediction:
        """Classify one sample; a FusionNet works with some of its senses.

        Args:
            rate: Sampling rate in Hz of arrays, and of files without one, of all or by modality;
                None is the checkpoint's.
            colour: Order of the colours of an array, ``rgb`` or, as in OpenCV, ``bgr``.
            **recordings: Recordings by modality: ``haptic``, ``image``, ``sound`` or a user's own.
                A signal is a file, or its samples: (samples,), (axes, samples) or (samples, axes)
                with 1 to 64 axes, in the unit of the training recordings. A photo is a file,
                or its pixels: (height, width, 3), or (height, width) in grey, uint8. They are
                resampled and resized for the checkpoint. None means absent.

        Raises:
            UserError: If the input is unusable, or of a modality that the checkpoint does not use.
        """
        inputs = {name: value for name, value in recordings.items() if value is not None}
        self.check_senses(inputs)
        decider = self.deciders[self._senses(inputs)]
        begin = time.perf_counter()
        try:
            decoded = self.decoded(inputs, rate=rate, colour=colour)
            vote = decider.classify(**{name: array for name, (array, _) in decoded.items()})
        except UserError as error:
            files = [str(value) for value in inputs.values() if isinstance(value, str | Path)]
            if not files or any(file in str(error) for file in files):
                raise
            raise UserError(f"{' and '.join(files)}: {error}") from error
        synchronise(decider.device)
        latency, fused = time.perf_counter() - begin, self.classifier.fusion is not None
        modalities = vote.modalities or decider.card.modalities if fused else ()
        quality = together(quality for _, quality in decoded.values())
        return make_prediction(vote, decider.card, quality, self.config.top_k, latency, modalities)

    @property
    def classes(self) -> list[str]:
        """Names of the classes, in the order of their probabilities."""
        return self.card.classes

    def __repr__(self) -> str:
        """Say what it is, what it takes, and how good it was in a cross-validation."""
        names = self.classes
        more = ", …" if len(names) > SHOWN else ""
        takes = [_taken(sense) for sense in self.classifier.senses.values()]
        parts = [
            self.card.title,
            f"{len(names)} classes ({', '.join(names[:SHOWN])}{more})",
            f"takes {' and '.join(takes)}",
            f"{self.classifier.count_parameters():,} parameters",
        ]
        if crossval := self.card.training.get("crossval"):
            low, high = crossval["vote_ci95"]
            counts = f"{crossval['correct']}/{crossval['test_samples']}"
            parts.append(
                f"{crossval['vote_accuracy']:.1%} ({counts}, {low:.1%} to {high:.1%}) in "
                f"{crossval['folds']} folds"
            )
        return f"<{type(self).__name__}: {'; '.join(parts)}>"

    def predict_many(
        self, *, rate: Rate = None, colour: str = "rgb", **recordings: Iterable[Input]
    ) -> list[Prediction]:
        """Classify several samples, one after the other; arguments are lists of those of `predict`.

        Args:
            rate: As in :meth:`predict`, of all.
            colour: As in :meth:`predict`, of all.
            **recordings: By modality a recording of each sample, in the same order; None in a list
                means absent.

        Returns:
            A prediction for each sample, equal to that of :meth:`predict`.

        Raises:
            UserError: If the lists have different lengths, or an input is unusable, which is told
                by its number.

        Example:
            >>> import tex_lightning as tl
            >>> model = tl.load("RUN")
            >>> len(model.predict_many(haptic=["A.wav", "A.wav"], image=["B.jpg", "B.jpg"]))
            2
        """
        for name, given in recordings.items():
            check_is_list(name, given)
        lists = {
            name: given if isinstance(given, Sized) else [*given]
            for name, given in recordings.items()
        }
        lengths = {name: len(given) for name, given in lists.items()}
        if len({*lengths.values()}) > 1:
            counts = ", ".join(f"{count} of {name}" for name, count in lengths.items())
            raise UserError(f"Give as many recordings of every modality, not {counts}.")
        predictions = []
        for number, sample in enumerate(zip(*lists.values(), strict=True)):
            try:
                named = dict(zip(lists, sample, strict=True))
                predictions.append(self.predict(rate=rate, colour=colour, **named))
            except UserError as error:
                raise UserError(f"Sample {number} (from 0): {error}") from error
        return predictions

    def stream(
        self, *live: str, rate: Rate = None, colour: str = "rgb", **photos: Input
    ) -> LiveStream:
        """Start to classify a live recording.

        Keys of the stream are arguments of :func:`load`: ``tl.load("RUN", "stream.window=2")``.

        Args:
            *live: Modalities of the live signals; by default all of the checkpoint.
            rate: Sampling rate in Hz, one for all or by modality; None is the checkpoint's.
            colour: Order of the colours, see :meth:`predict`.
            **photos: Photos as in :meth:`predict`, for the whole recording.

        Raises:
            UserError: If there is no signal, the network cannot classify a whole recording in a
                stream, or a photo is unusable.
        """
        senses = {sense.modality: sense for sense in self.classifier.senses.values()}
        signals = live or [name for name, sense in senses.items() if sense.medium == "signal"]
        fixed = {name: photo for name, photo in photos.items() if photo is not None}
        modalities = [*signals, *fixed]
        self.check_senses(modalities)
        unfit = [
            name for name in modalities if (senses[name].medium == "signal") != (name in signals)
        ]
        if unfit or not signals:
            raise UserError(
                "A live stream takes signals as they come and photos as they are; "
                + (f"{unfit[0]} is given as the other." if unfit else "give a signal.")
            )
        decider = self.deciders[self._senses(modalities)]
        decoded = self.decoded(fixed, colour=colour)
        rates = {name: rate.get(name) if isinstance(rate, Mapping) else rate for name in signals}
        full = decider.full if isinstance(decider, SequentialDecision) else decider
        return LiveStream(full, rates, decoded, self.config.stream, self.config.top_k)

    def check_senses(self, modalities: Collection[str]) -> None:
        """Reject an empty input, or a modality that this checkpoint does not use.

        Raises:
            UserError: Naming it.
        """
        known = self.card.modalities
        unused = [name for name in modalities if name not in known]
        if unused:
            raise UserError(
                f"This {self.card.title} does not look at {unused[0]}; leave {unused[0]}= "
                "out or give another checkpoint."
            )
        if not modalities:
            some = f"{known[0]}=FILE" if len(known) == 1 else f"some of {', '.join(known)}"
            raise UserError(f"There is nothing to classify; give {some}.")

    def _senses(self, modalities: Collection[str]) -> tuple[str, ...]:
        """Return the names of the senses that read these modalities."""
        senses = self.classifier.senses.items()
        return tuple(name for name, sense in senses if sense.modality in modalities)

    def decoded(
        self, inputs: Mapping[str, Input], *, rate: Rate = None, colour: str = "rgb"
    ) -> dict[str, tuple[Tensor, Quality]]:
        """Return decoded recordings and their quality by modality; arguments as of `predict`."""
        decoded: dict[str, tuple[Tensor, Quality]] = {}
        data = self.config.data
        rates = rate if isinstance(rate, Mapping) else dict.fromkeys(inputs, rate)
        how: dict[str, Any] = {"colour": colour, "channels": data.channels}
        how["time_unit"] = data.time_unit
        for sense in self.classifier.senses.values():
            name = sense.modality
            if name in inputs and name not in decoded:
                ranges = self.card.input_ranges.get(name, {})
                file_rate = rates.get(name)
                file_rate = data.file_rate if file_rate is None else file_rate
                decoded[name] = sense.decode_input(inputs[name], ranges, rate=file_rate, **how)
        return decoded


def _taken(sense: Sense) -> str:
    """Return the modality of a sense, and the rate of a signal."""
    decoder = sense.decoder
    if isinstance(decoder, SignalDecoder):
        return f"{sense.modality} at {decoder.sampling_rate:,.6g} Hz"
    return sense.modality
