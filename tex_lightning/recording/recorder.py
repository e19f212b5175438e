"""Make the recordings of ``task=record``: what is followed, shown, kept and said."""

import logging
import math
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Self

from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.check_tasks import RECORDED
from tex_lightning.core.console import console, print_line, say
from tex_lightning.data.quality import Ranges, photo_quality
from tex_lightning.errors import UserError
from tex_lightning.inference.predictor import Predictor
from tex_lightning.recording.class_folder import Camera, ClassFolder
from tex_lightning.recording.session import Contact, Feed, Session, Track
from tex_lightning.recording.sources import Chunk, open_source

KEYS = ("label", "rejected", "probability", "fragments", "latency_ms")  # of a prediction
NAME, BAR, LEVEL, TIME = 20, 10, 9, 11  # columns of their cells
DECADES = 2.0  # of level that the bar shows, below the largest so far

log = logging.getLogger(__name__)


def open_tracks(config: Config, stack: ExitStack, label: "RunningLabel | None") -> list[Track]:
    """Of all signals, the one that is classified first; their sources begin."""
    settings, given = config.record, config.files
    names: list[str] = [name for name in ("haptic", "sound") if name in given]
    if label is not None:
        label.check_recorded(names)
        names.sort(key=lambda name: name != label.modality)
    sources = {
        name: open_source(name, str(given[name]), getattr(settings, name), settings.timeout)
        for name in names
    }
    if label is not None:
        label.at_rate(sources[label.modality].rate)
    tracks = []
    for name, source in sources.items():
        feed = Feed(f"{name}={given[name]}", source, config.stream.chunk, settings.timeout)
        tracks.append(Track(name, stack.enter_context(feed)))
    return tracks


def record_photos(camera: Camera, folder: ClassFolder, count: int, seconds: float) -> None:
    """Take photos alone, with time between them to move on."""
    for done in range(count):
        if done:
            time.sleep(seconds)
        photo = camera.photo()
        _tell(folder.add({}, photo), photo_quality(photo, {}, "photo").warnings)


class Recorder:
    """Recordings of some signals, perhaps with a photo at the beginning of each.

    Args:
        config: The whole configuration.
        folder: Where they are written.
        tracks: Tracks of the signals, the first of which is followed.
        camera: Camera of the photos.
        label: The running label.
    """

    def __init__(
        self,
        config: Config,
        folder: ClassFolder,
        tracks: list[Track],
        camera: Camera | None,
        label: "RunningLabel | None",
    ) -> None:
        self.settings, self.folder, self.tracks = config.record, folder, tracks
        self.camera, self.label = camera, label
        contact = Contact(config.stream.chunk) if config.record.contact else None
        self.session = Session(tracks, config.record.seconds, contact, self._follow)
        self.meter = Meter(config.record.seconds)

    def record(self, count: int) -> None:
        """Make so many recordings, or as many as there are before the source ends.

        Raises:
            UserError: If there is none.
        """
        done, goes_on = 0, True
        while done < count and goes_on:
            goes_on = self._record_one()
            done += self._keep()
        if not done:
            lead, least = self.tracks[0], self.settings.least_seconds
            raise UserError(
                f"{lead.feed.name} has ended after {lead.seconds:.2f} s, and a recording has at "
                f"least record.least_seconds={least:g}; send more."
            )
        if done < count:
            log.info(
                "%s has ended after %d of %d recordings.", self.tracks[0].feed.name, done, count
            )

    def _record_one(self) -> bool:
        """Fill the tracks; returns whether the source goes on."""
        self.photo = None if self.camera is None else self.camera.photo()
        self.name = self.folder.next_name()
        if self.label is not None:
            self.label.begin()
        try:
            with self.meter:
                return self.session.record()
        except KeyboardInterrupt:
            if not self._keep():
                log.info("Interrupted; what was begun is not kept.")
            raise

    def _follow(self, chunk: Chunk, level: float, recorded: bool) -> None:
        found = self.label.push(chunk) if self.label is not None and recorded else {}
        seconds = round(self.tracks[0].seconds, 6)
        self.meter.show(self.name if recorded else None, seconds, level, found)

    def _keep(self) -> bool:
        """Write what the tracks hold, if it is enough; returns whether it is."""
        seconds = min(track.seconds for track in self.tracks)
        if seconds < self.settings.least_seconds:
            if seconds:
                log.info("%.2f s are too short and not kept (record.least_seconds).", seconds)
            return False
        ranges = {} if self.label is None else self.label.ranges
        warnings = [
            text for track in self.tracks for text in track.warnings(ranges.get(track.modality, {}))
        ]
        if self.photo is not None:
            warnings += photo_quality(self.photo, {}, "photo").warnings
        signals = {track.modality: (track.rate, track.samples) for track in self.tracks}
        _tell(self.folder.add(signals, self.photo), warnings, seconds=seconds)
        return True


class RunningLabel:
    """The running label of a checkpoint while a recording goes on.

    Args:
        config: Names the checkpoint.

    Raises:
        UserError: If it cannot be streamed.
    """

    def __init__(self, config: Config) -> None:
        self.predictor = Predictor(load_classifier(str(config.checkpoint)), config)
        self.rate: float | None = None  # the checkpoint's, until it is known
        self.modality = next(iter(self.predictor.stream().signals))
        self.begin()
        self.ranges: dict[str, Ranges] = dict(self.predictor.card.input_ranges)

    def check_recorded(self, names: Sequence[str]) -> None:
        """Refuse to record without the sense that it looks at."""
        if self.modality not in names:
            more = f"give {self.modality}=SOURCE or " if self.modality in RECORDED else ""
            raise UserError(
                f"This {self.predictor.card.title} looks at {self.modality}, which is not "
                f"recorded; {more}leave checkpoint= out."
            )

    def at_rate(self, rate: float) -> None:
        """Take samples at this rate in Hz from now on."""
        self.rate = rate
        self.begin()

    def begin(self) -> None:
        """Forget the last recording."""
        self.stream = self.predictor.stream(self.modality, rate=self.rate)

    def push(self, chunk: Chunk) -> dict[str, Any]:
        """Take the next samples; what is known by then."""
        found = self.stream.push(chunk).to_dict()
        return {key: found[key] for key in KEYS if key in found}


def _tell(files: Sequence[Path], warnings: Sequence[str], **more: object) -> None:
    """Print the files written, and their faults."""
    name, paths = files[0].stem, [str(file) for file in files]
    if prints_lines():
        print_line({"recording": name, **more, "files": paths, "warnings": list(warnings)})
    for text in warnings:
        log.warning("%s: %s", name, text)
    text = f"{name} is written: {', '.join(paths)}."
    if prints_lines():
        log.info("%s", text)
    else:
        say(text)


def prints_lines() -> bool:
    """Whether standard output gets JSON objects: unless a person looks at a terminal alone."""
    return not (console.is_terminal and sys.stdout.isatty())


class Meter:
    """Level, time and label, as a ``with`` block; the line is gone after it.

    Standard error gets the line if it is a terminal.

    Args:
        seconds: Seconds of a whole recording.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds, self.largest = seconds, 0.0
        self._live = Live(console=console, transient=True, auto_refresh=False)

    def __enter__(self) -> Self:
        if console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._live.stop()

    def show(self, name: str | None, time: float, level: float, found: dict[str, Any]) -> None:
        """Show one chunk.

        Args:
            name: Name of the recording; None while it waits for contact.
            time: Recorded so far, in seconds.
            level: Level of the chunk, in the unit of the signal.
            found: ``label`` and ``probability``, and what else there is; empty without a network.
        """
        self.largest = max(self.largest, level)
        if prints_lines():
            print_line({"recording": name, "time": time, "level": float(f"{level:.4g}"), **found})
        if console.is_terminal:
            self._live.update(self._line(name, time, level, found), refresh=True)

    def _line(self, name: str | None, time: float, level: float, found: dict[str, Any]) -> Table:
        label, probability = found.get("label"), found.get("probability")
        said = f"{probability:.2f} {label}" if label is not None else ""
        clock = f"{time:.1f}/{self.seconds:g} s" if name else "no contact"
        bar = ProgressBar(total=1.0, completed=self._share(level), width=BAR)
        grid = Table.grid(padding=(0, 1))
        for width in (NAME, BAR, LEVEL, TIME, None):
            grid.add_column(width=width, no_wrap=True, overflow="ellipsis")
        grid.add_row(name or "waiting for contact", bar, f"{level:.3g}", clock, said)
        return grid

    def _share(self, level: float) -> float:
        """Of the bar: logarithmic, full at the largest level so far."""
        if level <= 0 or self.largest <= 0:
            return 0.0
        return max(0.0, 1 + math.log10(level / self.largest) / DECADES)
