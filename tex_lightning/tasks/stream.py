"""Classify while a recording goes on: one JSON object per chunk on standard output."""

import json
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from torch import Tensor

from tex_lightning.classifier import SurfaceClassifier, check_frames
from tex_lightning.data.decode import decode_trace, usable_samples
from tex_lightning.decision.voting import Vote
from tex_lightning.devices import pick_device, synchronise
from tex_lightning.errors import UserError
from tex_lightning.inference.engine import accelerate
from tex_lightning.schema import Config
from tex_lightning.streaming.classifier import StreamingClassifier

SAMPLE = np.dtype("<f4")  # of standard input


def run(config: Config, directory: Path) -> None:
    """Push the file, or standard input, chunk by chunk and print the vote after each.

    Where samples wait at the end (``stream.wait``), one more line gives the vote of all.

    Raises:
        UserError: If the checkpoint cannot be streamed, the samples cannot be read, or they end
            before there is one fragment.
    """
    classifier = SurfaceClassifier.from_checkpoint(cast(str, config.checkpoint))
    device = pick_device(config.trainer.accelerator)
    engine = accelerate(classifier.to(device), config.engine)
    stream = StreamingClassifier(engine, wait=config.stream.wait)
    rate = stream.features.sampling_rate
    size = max(1, round(config.stream.chunk * rate))
    if config.haptic == "-":
        chunks = _from_standard_input(config, rate, size)
    else:
        if not isinstance(config.haptic, str):
            raise UserError(f"haptic={config.haptic} is several; give one file, or - for a pipe.")
        path = Path(config.haptic).expanduser()
        trace = decode_trace(path, classifier.card.settings_for(config.data.file_rate))
        chunks = iter(torch.split(torch.from_numpy(trace), size, dim=1))
    samples = 0

    def say(push: Callable[[], Vote | None]) -> None:
        begin = time.perf_counter()
        vote = push()
        synchronise(device)
        latency = (time.perf_counter() - begin) * 1000
        line = {
            "time": round(samples / rate, 6),
            **_report(vote, classifier.card.classes, config.decision.reject_below),
            "latency_ms": round(latency, 3),
        }
        print(json.dumps(line), flush=True)

    for chunk in chunks:
        samples += chunk.shape[1]
        say(partial(stream.push, chunk))
    if stream.waiting is not None:
        say(stream.finish)
    check_frames(stream.frames, stream.features)


def _report(vote: Vote | None, classes: list[str], least: float | None) -> dict[str, Any]:
    """Of a line; there is no label before the first fragment."""
    if vote is None:
        rejected = {} if least is None else {"rejected": False}
        return {"label": None, **rejected, "confidence": None, "fragments": 0}
    return {
        **vote.named(classes, least),
        "confidence": float(vote.shares[vote.label]),
        "fragments": len(vote.fragments),
    }


def _from_standard_input(config: Config, rate: float, size: int) -> Iterator[Tensor]:
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
        yield torch.from_numpy(samples.T.astype(np.float32))
