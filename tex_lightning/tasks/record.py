"""Record from sensors into the folder of a class, so that a data set grows by stroking."""

import logging
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.config import Config
from tex_lightning.config.check_tasks import RECORDED
from tex_lightning.config.job import Job
from tex_lightning.data.quality import Ranges, photo_quality
from tex_lightning.errors import UserError
from tex_lightning.lines import print_line
from tex_lightning.predictor import Predictor
from tex_lightning.recording.camera import Camera
from tex_lightning.recording.class_folder import ClassFolder
from tex_lightning.recording.contact import Contact
from tex_lightning.recording.feed import Feed
from tex_lightning.recording.meter import Meter, prints_lines
from tex_lightning.recording.opening import open_source
from tex_lightning.recording.parsing import Chunk
from tex_lightning.recording.session import Session
from tex_lightning.recording.track import Track
from tex_lightning.screen import say

KEYS = ("label", "rejected", "probability", "fragments", "latency_ms")  # of a prediction

log = logging.getLogger(__name__)


def run(config: Config, job: Job) -> None:
    """Add ``record.count`` recordings to ``record.out/record.label`` and to its manifest.

    A recording is written when it is whole; one that is interrupted is kept as far as it went, if
    that is long enough.

    Raises:
        UserError: If a sensor, the checkpoint or the folder cannot be used; recordings that were
            finished stay.
    """
    settings = config.record
    out = Path(str(settings.out)).expanduser()
    folder = ClassFolder(out, str(settings.label), settings.conditions)
    label = None if config.checkpoint is None else _RunningLabel(config)
    photos = config.files.get("image")
    with ExitStack() as stack:
        camera = stack.enter_context(closing(Camera(str(photos)))) if photos else None
        tracks = _tracks(config, stack, label)
        if camera is not None and not tracks:
            _record_photos(camera, folder, settings.count, settings.seconds)
        else:
            _Recorder(config, folder, tracks, camera, label).record(settings.count)


def _tracks(config: Config, stack: ExitStack, label: "_RunningLabel | None") -> list[Track]:
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


def _record_photos(camera: Camera, folder: ClassFolder, count: int, seconds: float) -> None:
    """Take photos alone, with time between them to move on."""
    for done in range(count):
        if done:
            time.sleep(seconds)
        photo = camera.photo()
        _tell(folder.add({}, photo), photo_quality(photo, {}, "photo").warnings)


class _Recorder:
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
        label: "_RunningLabel | None",
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


class _RunningLabel:
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
