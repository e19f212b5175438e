"""Classify a recording while it goes on: one JSON object per chunk on standard output."""

import logging
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config, Job
from tex_lightning.core.console import log_once, print_line
from tex_lightning.core.files import standard_input
from tex_lightning.errors import UserError
from tex_lightning.inference.prediction import Prediction
from tex_lightning.inference.predictor import Predictor
from tex_lightning.senses.signal import SignalSense
from tex_lightning_runtime.files import expanded
from tex_lightning_runtime.samples import check_samples

SAMPLE = np.dtype("<f4")  # of standard input
KEYS = (
    "label", "rejected", "probability", "confidence", "fragments", "novelty", "warnings",
    "latency_ms",
)  # fmt: skip

log = logging.getLogger(__name__)
Chunk = npt.NDArray[np.floating]


def run(config: Config, job: Job) -> None:
    """Push the signals, from files or standard input, chunk by chunk; print the vote after each.

    Raises:
        UserError: If the checkpoint cannot be streamed, the samples cannot be read, or they end
            before there is one fragment.
    """
    predictor = Predictor(load_classifier(str(config.checkpoint)), config)
    predictor.check_senses(config.files)
    senses = {sense_.modality: sense_ for sense_ in predictor.classifier.senses.values()}
    rates, chunks, photos = {}, {}, {}
    for name, file in config.files.items():
        if isinstance(file, list | dict):
            raise UserError(f"{name}={file} is several; give one file, or - for a pipe.")
        sense = senses[name]
        if isinstance(sense, SignalSense):
            rates[name], chunks[name] = _open(config, sense, str(file))
        else:
            photos[name] = str(file)
    if not rates:
        raise UserError(
            "A stream needs a signal, and photos only beside it; give a signal too, or "
            "use task=predict."
        )
    stream = predictor.stream(*rates, rate=rates, **photos)
    first = next(iter(stream.signals.values()))

    def show(prediction: Prediction) -> None:
        values = prediction.to_dict()
        time = round(first.samples / first.rate, 6)
        print_line({"time": time, **{key: values[key] for key in KEYS if key in values}})

    for parts in zip(*chunks.values(), strict=False):  # until the shortest ends
        show(stream.push(**dict(zip(chunks, parts, strict=True))))
    stream.check()


def _open(config: Config, sense: SignalSense, file: str) -> tuple[float, Iterator[Chunk]]:
    """Return rate in Hz and chunks (axes, samples) of ``stream.chunk`` seconds of a signal.

    Standard input has the rate ``data.file_rate``, or the checkpoint's.
    """
    if file == "-":
        rate = config.data.file_rate or sense.decoder.sampling_rate
        size = max(1, round(config.stream.chunk * rate))
        return rate, _from_standard_input(config.stream.axes, size)
    data = config.data
    decoder = sense.decoder.assuming(data.file_rate, data.channels, data.time_unit)
    if decoder.channels and all(isinstance(channel, int) for channel in decoder.channels):
        decoder = replace(decoder, channels=None)  # not yet; names are those of the file
    trace, rate, reading = decoder.read(expanded(file))
    log_once(log, f"Reads {reading.said(rate)}.")
    size = max(1, round(config.stream.chunk * rate))
    return rate, (trace[:, i : i + size] for i in range(0, trace.shape[1], size))


def _from_standard_input(axes: int, size: int) -> Iterator[Chunk]:
    """Yield chunks (axes, samples) of raw float32, little-endian, all axes of a sample together."""
    position = 0
    stdin = standard_input().buffer
    while content := stdin.read(size * axes * SAMPLE.itemsize):
        if len(content) % (axes * SAMPLE.itemsize):
            raise UserError(
                f"Standard input ends within a sample; send {axes} float32 numbers for each "
                "(stream.axes)."
            )
        samples = np.frombuffer(content, SAMPLE).reshape(-1, axes)
        check_samples(samples.T, "Standard input, read as little-endian float32,", position)
        position += len(samples)
        yield samples.T.astype(np.float32)
