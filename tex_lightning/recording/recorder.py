"""Record several signals side by side, and photos.

Every source is read in a thread of its own, so that no sensor waits for another.
"""

import logging
import queue
import sys
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import Self

import numpy as np

from tex_lightning.config import Config
from tex_lightning.core.console import console, print_line, say
from tex_lightning.core.progress import track
from tex_lightning.data.recordings import singular
from tex_lightning.errors import UserError
from tex_lightning.recording.class_folder import ClassFolder
from tex_lightning.recording.sources import WAIT, Chunk, Pixels, Source, open_source
from tex_lightning_runtime.quality import photo_quality, trace_quality

HELD = 100  # pieces that wait for the recorder; then a pipe's writer waits, too
TOLERANCE = 0.1  # of a rate, as a share
STEP = 0.1  # seconds that are taken of each signal in turn

log = logging.getLogger(__name__)


class Signal:
    """The signal of one sensor; a thread reads it inside a ``with`` block.

    Args:
        modality: ``haptic`` or ``sound``.
        name: Name of the source, for messages.
        source: Where samples come from.
        timeout: Longest time without samples in seconds.

    Attributes:
        count: Samples (of each axis) that have arrived and belong to no earlier recording.
    """

    def __init__(self, modality: str, name: str, source: Source, timeout: float) -> None:
        self.modality, self.name, self.source, self.timeout = modality, name, source, timeout
        self.count = 0
        self._pieces: list[Chunk] = []
        self._held: queue.Queue[Chunk | Exception | None] = queue.Queue(HELD)
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._times: list[float] = []  # of the first samples, which are not counted, and the last
        self._arrived = 0

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._stopped.set()
        self._thread.join(3 * WAIT)  # one that waits for a silent pipe ends with the program

    def _run(self) -> None:
        pieces = self.source.chunks()
        try:
            for piece in pieces:
                if self._stopped.is_set():
                    return
                if piece is not None and piece.size:
                    self._arrived += piece.shape[1] if self._times else 0
                    self._times[1:] = [time.monotonic()]
                    self._put(piece)
            self._put(None)
        except Exception as error:  # is raised in the other thread
            self._put(error)
        finally:
            pieces.close()

    def _put(self, item: Chunk | Exception | None) -> None:
        while not self._stopped.is_set():
            try:
                return self._held.put(item, timeout=WAIT)
            except queue.Full:
                continue

    def fill(self, seconds: float) -> bool:
        """Wait until so many seconds have arrived; return whether they have before the end.

        Raises:
            UserError: If the source fails, or sends nothing for too long.
        """
        while self.count < round(seconds * self.source.rate):
            try:
                piece = self._held.get(timeout=self.timeout)
            except queue.Empty as error:
                raise UserError(
                    f"{self.name} has sent nothing for {self.timeout:g} s; check the sensor, or "
                    "give a larger record.timeout."
                ) from error
            if isinstance(piece, Exception):
                raise piece
            if piece is None:
                self._held.put(None)  # so that it stays the end
                return False
            self._pieces.append(piece)
            self.count += piece.shape[1]
        return True

    def take(self, seconds: float) -> Chunk:
        """Remove the first seconds and return them as a recording (axes, samples), float32."""
        count = round(seconds * self.source.rate)
        whole = np.concatenate(self._pieces, axis=1)
        self._pieces = [whole[:, count:]]
        self.count -= count
        return whole[:, :count]

    def warnings(self, samples: Chunk) -> list[str]:
        """Return the faults of a recording (axes, samples), a sentence each."""
        what = singular(self.modality)
        warnings = list(trace_quality(samples, {}, what, {}).warnings)
        if self.source.lost:
            self.source.lost = False
            warnings.append(f"Samples of the {what} were lost; close other programs.")
        if self.source.timed and len(self._times) == 2:
            rate = self._arrived / (self._times[1] - self._times[0])
            if abs(rate / self.source.rate - 1) > TOLERANCE:
                warnings.append(
                    f"The {what} arrives at {rate:.0f} Hz, and record.{self.modality}.rate is "
                    f"{self.source.rate}; correct that, or the sensor."
                )
        return warnings


def record(config: Config, folder: ClassFolder, camera: Callable[[], Pixels] | None) -> None:
    """Make ``record.count`` recordings, or as many as there are before a source ends.

    The camera takes a photo at the beginning of each; photos alone are ``record.seconds`` apart.

    Raises:
        UserError: If a source cannot be used, or ends before one recording is whole.
    """
    settings, done = config.record, 0
    with ExitStack() as stack:
        signals = [
            stack.enter_context(_open_signal(config, modality))
            for modality in ("haptic", "sound")
            if modality in config.files
        ]
        for done in range(settings.count):
            if done and not signals:
                time.sleep(settings.seconds)
            photo = None if camera is None else camera()
            if not _fill(signals, settings.seconds, folder.next_name()):
                break
            _write(folder, signals, photo, settings.seconds)
        else:
            return
    if not done:
        raise UserError(
            f"{signals[0].name} has ended before a recording was as long as "
            f"record.seconds={settings.seconds:g}; send more."
        )
    log.info("The source has ended after %d of %d recordings.", done, settings.count)


def _open_signal(config: Config, modality: str) -> Signal:
    name = str(config.files[modality])
    source = open_source(modality, name, getattr(config.record, modality))
    return Signal(modality, f"{modality}={name}", source, config.record.timeout)


def _fill(signals: Sequence[Signal], seconds: float, name: str) -> bool:
    """Wait for so many seconds of all signals, in turn; return whether they come before the end."""
    steps = np.arange(STEP, seconds + STEP, STEP).clip(max=seconds).tolist()
    return all(signal.fill(end) for end in track(steps, name) for signal in signals)


def _write(
    folder: ClassFolder, signals: Sequence[Signal], photo: Pixels | None, seconds: float
) -> None:
    """Write a recording and print its files and faults: as JSON, unless on a terminal."""
    samples = [signal.take(seconds) for signal in signals]
    warnings = [
        text
        for signal, chunk in zip(signals, samples, strict=True)
        for text in signal.warnings(chunk)
    ]
    if photo is not None:
        warnings += photo_quality(photo, {}, "photo").warnings
    named = zip(signals, samples, strict=True)
    files = folder.add({s.modality: (s.source.rate, chunk) for s, chunk in named}, photo)
    name, paths = files[0].stem, [str(file) for file in files]
    for text in warnings:
        log.warning("%s: %s", name, text)
    if console.is_terminal and sys.stdout.isatty():
        say(f"{name} is written: {', '.join(paths)}.")
    else:
        length = {"seconds": seconds} if signals else {}
        print_line({"recording": name, **length, "files": paths, "warnings": warnings})
