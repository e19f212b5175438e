"""Make the recordings of ``task=record``: what is followed, shown, kept and said."""

import logging
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path

from rich.status import Status
from rich.text import Text

from tex_lightning.config import Config
from tex_lightning.core.console import console, print_line, say
from tex_lightning.data.quality import photo_quality
from tex_lightning.errors import UserError
from tex_lightning.inference.predictor import Predictor
from tex_lightning.recording.class_folder import Camera, ClassFolder
from tex_lightning.recording.session import Contact, Feed, Session, Track
from tex_lightning.recording.sources import Chunk, open_source
from tex_lightning.text import printable

KEYS = ("label", "rejected", "probability", "fragments", "latency_ms")  # of a prediction

log = logging.getLogger(__name__)


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
        camera: Camera of the photos.
        predictor: Classifies the first signal on the way; None does not.
        stack: Closes the sources, which begin.

    Raises:
        UserError: If a source cannot be used, or the classified sense is not recorded.
    """

    def __init__(
        self,
        config: Config,
        folder: ClassFolder,
        camera: Camera | None,
        predictor: Predictor | None,
        stack: ExitStack,
    ) -> None:
        self.settings, self.folder = config.record, folder
        self.camera, self.predictor = camera, predictor
        self.ranges = {} if predictor is None else predictor.card.input_ranges
        self.tracks = []
        for name in self._followed([name for name in ("haptic", "sound") if name in config.files]):
            given = str(config.files[name])
            source = open_source(name, given, getattr(config.record, name))
            feed = Feed(f"{name}={given}", source, config.stream.chunk, config.record.timeout)
            self.tracks.append(Track(name, stack.enter_context(feed)))
        contact = Contact(config.stream.chunk) if config.record.contact else None
        self.session = Session(self.tracks, config.record.seconds, contact, self.follow)
        self.status = Status("", console=console)
        self._begin()

    def _followed(self, names: list[str]) -> list[str]:
        """The recorded signals, the one that is classified first."""
        if self.predictor is None:
            return names
        wanted = next(iter(self.predictor.stream().signals))
        if wanted not in names:
            raise UserError(
                f"This {self.predictor.card.title} looks at {wanted}, which is not recorded; give "
                f"{wanted}=SOURCE, if task=record takes it, or leave checkpoint= out."
            )
        return sorted(names, key=lambda name: name != wanted)

    def record(self, count: int) -> None:
        """Make so many recordings, or as many as there are before the source ends.

        Raises:
            UserError: If there is none.
        """
        done, goes_on, lead = 0, True, self.tracks[0]
        while done < count and goes_on:
            goes_on = self._record_one()
            done += self._keep()
        if not done:
            raise UserError(
                f"{lead.feed.name} has ended after {lead.seconds:.2f} s, and a recording has at "
                f"least record.least_seconds={self.settings.least_seconds:g}; send more."
            )
        if done < count:
            log.info("%s has ended after %d of %d recordings.", lead.feed.name, done, count)

    def _begin(self) -> None:
        """Forget the last recording."""
        self.name = self.folder.next_name()
        if self.predictor is not None:
            lead = self.tracks[0]
            self.stream = self.predictor.stream(lead.modality, rate=float(lead.rate))

    def _record_one(self) -> bool:
        """Fill the tracks; returns whether the source goes on."""
        self.photo = None if self.camera is None else self.camera.photo()
        self._begin()
        try:
            with self.status if console.is_terminal else nullcontext():
                return self.session.record()
        except KeyboardInterrupt:
            if not self._keep():
                log.info("Interrupted; what was begun is not kept.")
            raise

    def follow(self, chunk: Chunk, level: float, recorded: bool) -> None:
        """Classify and show a chunk of the first signal, on one line of a terminal or as JSON."""
        found = self.stream.push(chunk).to_dict() if self.predictor and recorded else {}
        found = {key: found[key] for key in KEYS if key in found}
        seconds = round(self.tracks[0].seconds, 6)
        name = self.name if recorded else None
        if _prints_lines():
            line = {"recording": name, "time": seconds, "level": float(f"{level:.4g}")}
            print_line({**line, **found})
        clock = f"{seconds:.1f}/{self.settings.seconds:g} s" if recorded else "waiting for contact"
        label = found.get("label")
        said = f"{found['probability']:.2f} {label}" if label is not None else ""
        text = printable(f"{self.name}  {clock}  level {level:.3g}  {said}")
        self.status.update(Text(text, no_wrap=True, overflow="ellipsis"))

    def _keep(self) -> bool:
        """Write what the tracks hold, if it is enough; returns whether it is."""
        seconds = min(track.seconds for track in self.tracks)
        if seconds < self.settings.least_seconds:
            if seconds:
                log.info("%.2f s are too short and not kept (record.least_seconds).", seconds)
            return False
        warnings = [
            text
            for track in self.tracks
            for text in track.warnings(self.ranges.get(track.modality, {}))
        ]
        if self.photo is not None:
            warnings += photo_quality(self.photo, {}, "photo").warnings
        signals = {track.modality: (track.rate, track.samples) for track in self.tracks}
        _tell(self.folder.add(signals, self.photo), warnings, seconds=seconds)
        return True


def _tell(files: Sequence[Path], warnings: Sequence[str], **more: object) -> None:
    """Print the files written, and their faults."""
    name, paths = files[0].stem, [str(file) for file in files]
    for text in warnings:
        log.warning("%s: %s", name, text)
    if _prints_lines():
        print_line({"recording": name, **more, "files": paths, "warnings": list(warnings)})
    else:
        say(f"{name} is written: {', '.join(paths)}.")


def _prints_lines() -> bool:
    """Whether standard output gets JSON objects: unless a person looks at a terminal alone."""
    return not (console.is_terminal and sys.stdout.isatty())
