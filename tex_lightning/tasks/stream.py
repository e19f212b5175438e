"""Classify a recording while it goes on: one JSON object per chunk on standard output."""

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.composition import Job
from tex_lightning.core.console import print_line
from tex_lightning.data.decode import check_samples, read_trace
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import Prediction
from tex_lightning.inference.predictor import Predictor
from tex_lightning.senses.signal import SignalSense

SAMPLE = np.dtype("<f4")  # of standard input
KEYS = (
    "label", "rejected", "probability", "confidence", "fragments", "contact", "novelty",
    "warnings", "latency_ms",
)  # fmt: skip
PIPE = "-"

Chunk = npt.NDArray[np.floating]


def run(config: Config, job: Job) -> None:
    """Push the signals, from files or standard input, chunk by chunk; print the vote after each.

    Where the filter of another rate holds samples back, one more line gives the vote of all.

    Raises:
        UserError: If the checkpoint cannot be streamed, the samples cannot be read, or they end
            before there is one fragment.
    """
    predictor = Predictor(load_classifier(str(config.checkpoint)), config)
    predictor.check_senses(config.files)
    senses = {each.modality: each for each in predictor.classifier.senses.values()}
    signals: dict[str, Signal] = {}
    photos = {}
    for name, given in config.files.items():
        sense = senses[name]
        if isinstance(given, list | dict):
            raise UserError(f"{name}={given} is several; give one file, or - for a pipe.")
        if isinstance(sense, SignalSense):
            signals[name] = _open(config, sense, str(given))
        else:
            photos[name] = str(given)
    if not signals:
        raise UserError(
            "A stream takes a signal as it goes on, and photos beside it; give a signal too, or "
            "use task=predict."
        )
    rates = {name: signal.rate for name, signal in signals.items()}
    stream = predictor.stream(*signals, rate=rates, **photos)
    first = next(iter(stream.signals.values()))

    def say(push: Callable[[], Prediction]) -> None:
        found = push().to_dict()
        time = round(first.samples / first.rate, 6)
        print_line({"time": time, **{key: found[key] for key in KEYS if key in found}})

    every = zip(*(signal.chunks(config) for signal in signals.values()), strict=False)
    for chunks in every:  # until the shortest ends
        say(partial(stream.push, **dict(zip(signals, chunks, strict=True))))
    if stream.waiting:
        say(stream.finish)
    stream.check()


@dataclass(frozen=True)
class Signal:
    """The signal that is replayed or read.

    Attributes:
        rate: Rate in Hz.
        trace: (axes, samples) of a file; None for standard input.
    """

    rate: float
    trace: Chunk | None

    def chunks(self, config: Config) -> Iterator[Chunk]:
        """Chunks (axes, samples) of ``stream.chunk`` seconds."""
        size = max(1, round(config.stream.chunk * self.rate))
        if self.trace is None:
            yield from _from_standard_input(config.stream.axes, size)
        else:
            for start in range(0, self.trace.shape[1], size):
                yield self.trace[:, start : start + size]


def _open(config: Config, sense: SignalSense, given: str) -> Signal:
    """A file, or standard input at ``data.file_rate``, of itself the checkpoint's."""
    if given == PIPE:
        rate = config.data.file_rate
        return Signal(sense.decoder.sampling_rate if rate is None else rate, None)
    decoder = replace(sense.decoder.assuming(config.data.file_rate), channels=None)  # not yet
    trace, source = read_trace(Path(given).expanduser(), decoder)
    return Signal(source.hz, trace)


def _from_standard_input(axes: int, size: int) -> Iterator[Chunk]:
    """Chunks (axes, samples) of raw float32, little-endian, all axes of a sample together."""
    place = 0
    while content := sys.stdin.buffer.read(size * axes * SAMPLE.itemsize):
        if len(content) % (axes * SAMPLE.itemsize):
            raise UserError(
                f"Standard input ends within a sample; send {axes} float32 numbers for each "
                "(stream.axes)."
            )
        samples = np.frombuffer(content, SAMPLE).reshape(-1, axes)
        check_samples(samples.T, "Standard input, read as little-endian float32,", place)
        place += len(samples)
        yield samples.T.astype(np.float32)
