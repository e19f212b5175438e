"""Classify while a recording goes on: one JSON object per chunk on standard output."""

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.job import Job
from tex_lightning.data.decode import usable_samples
from tex_lightning.errors import UserError
from tex_lightning.inference.streaming.live import LiveStream
from tex_lightning.lines import print_line
from tex_lightning.prediction import Prediction
from tex_lightning.predictor import Predictor

SAMPLE = np.dtype("<f4")  # of standard input
KEYS = ("label", "rejected", "probability", "confidence", "fragments", "warnings", "latency_ms")

Chunk = npt.NDArray[np.float32]


def run(config: Config, job: Job) -> None:
    """Push the file, or standard input, chunk by chunk and print the vote after each.

    Where samples wait at the end (``stream.wait``), one more line gives the vote of all.

    Raises:
        UserError: If the checkpoint cannot be streamed, the samples cannot be read, or they end
            before there is one fragment.
    """
    predictor = Predictor(load_classifier(str(config.checkpoint)), config.prediction)
    stream = predictor.stream()
    samples = 0

    def say(push: Callable[[], Prediction]) -> None:
        found = push().to_dict()
        time = round(samples / stream.rate, 6)
        print_line({"time": time, **{key: found[key] for key in KEYS if key in found}})

    for chunk in _chunks(config, predictor, stream):
        samples += chunk.shape[1]
        say(partial(stream.push, chunk))
    if stream.waiting:
        say(stream.finish)
    stream.check()


def _chunks(config: Config, predictor: Predictor, stream: LiveStream) -> Iterator[Chunk]:
    """Chunks (axes, samples) of the file, or of standard input."""
    size = max(1, round(config.stream.chunk * stream.rate))
    predictor.check_senses(config.files)
    ((modality, given),) = config.files.items()
    if given == "-":
        yield from _from_standard_input(config, stream.rate, size)
        return
    if isinstance(given, list | dict):
        raise UserError(f"{modality}={given} is several; give one file, or - for a pipe.")
    path, decoder = Path(str(given)).expanduser(), stream.classifier.branch.decoder
    trace, _ = decoder.assuming(config.data.file_rate).decode(path)
    for start in range(0, trace.shape[1], size):
        yield trace[:, start : start + size]


def _from_standard_input(config: Config, rate: float, size: int) -> Iterator[Chunk]:
    """Chunks (axes, samples) of raw float32, little-endian, all axes of a sample together."""
    if config.data.file_rate not in (None, rate):
        raise UserError(
            f"data.file_rate is {config.data.file_rate:g}, but standard input is read at the "
            f"checkpoint's {rate:g} Hz; bring the samples to that rate."
        )
    axes, place = config.stream.axes, 0
    while content := sys.stdin.buffer.read(size * axes * SAMPLE.itemsize):
        if len(content) % (axes * SAMPLE.itemsize):
            raise UserError(
                f"Standard input ends within a sample; send {axes} float32 numbers for each "
                "(stream.axes)."
            )
        samples = np.frombuffer(content, SAMPLE).reshape(-1, axes)
        if not (usable := usable_samples(samples.T)).all():
            first = place + int(np.flatnonzero(~usable)[0])
            raise UserError(
                f"Standard input holds NaN, infinity or a huge number at sample {first}; send "
                "little-endian float32 numbers."
            )
        place += len(samples)
        yield samples.T.astype(np.float32)
