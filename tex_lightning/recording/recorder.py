"""Make the recordings of ``task=record``: what is followed, shown, kept and said."""

import logging
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, nullcontext
from pathlib import Path

from rich.status import Status
from rich.text import Text

from tex_lightning.config import Config
from tex_lightning.core.console import console, print_line, say
from tex_lightning.data.quality import photo_quality
from tex_lightning.errors import UserError
from tex_lightning.inference.predictor import Predictor
from tex_lightning.recording.class_folder import ClassFolder, Pixels
from tex_lightning.recording.session import Contact, Session, Signal
from tex_lightning.recording.sources import Chunk, open_source
from tex_lightning.text import printable

Camera = Callable[[], Pixels]
KEYS = ("label", "rejected", "probability", "fragments", "latency_ms")  # of a prediction

log = logging.getLogger(__name__)


def record_photos(camera: Camera, folder: ClassFolder, count: int, seconds: float) -> None:
    """Take photos alone, with time between them to move on."""
    for done in range(count):
        if done:
            time.sleep(seconds)
        photo = camera()
        _tell(folder.add({}, photo), photo_quality(photo, {}, "photo").warnings)


class Recorder:
    """Recordings of some signals, perhaps with a photo at the beginning of each.

    Args:
        config: The whole configuration.
        folder: Where they are written.
        camera: Function that takes a photo; None takes none.
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
        seconds, timeout = config.stream.chunk, config.record.timeout
        self.signals = []
        for name in self._followed([name for name in ("haptic", "sound") if name in config.files]):
            given = str(config.files[name])
            source = open_source(name, given, getattr(config.record, name))
            signal = Signal(name, f"{name}={given}", source, seconds, timeout)
            self.signals.append(stack.enter_context(signal))
        contact = Contact(seconds) if config.record.contact else None
        self.session = Session(self.signals, config.record.seconds, contact, self.follow)
        self.status = Status("", console=console)
        self._begin()

    def _followed(self, names: list[str]) -> list[str]:
        """Sort the recorded signals so that the classified one is the first."""
        if self.predictor is None:
            return names
        classified = next(iter(self.predictor.stream().signals))
        if classified not in names:
            raise UserError(
                f"This {self.predictor.card.title} looks at {classified}, which is not recorded; "
                f"give {classified}=SOURCE, if task=record takes it, or leave checkpoint= out."
            )
        return sorted(names, key=lambda name: name != classified)

    def record(self, count: int) -> None:
        """Make so many recordings, or as many as there are before the source ends.

        Raises:
            UserError: If there is none.
        """
        done, goes_on, lead = 0, True, self.signals[0]
        while done < count and goes_on:
            goes_on = self._record_one()
            done += self._keep()
        if not done:
            raise UserError(
                f"{lead.name} has ended after {lead.seconds:.2f} s, and a recording has at "
                f"least record.least_seconds={self.settings.least_seconds:g}; send more."
            )
        if done < count:
            log.info("%s has ended after %d of %d recordings.", lead.name, done, count)

    def _begin(self) -> None:
        """Forget the last recording."""
        self.name = self.folder.next_name()
        if self.predictor is not None:
            lead = self.signals[0]
            self.stream = self.predictor.stream(lead.modality, rate=float(lead.rate))

    def _record_one(self) -> bool:
        """Make a recording; return whether the source goes on."""
        self.photo = None if self.camera is None else self.camera()
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
        result = self.stream.push(chunk).to_dict() if self.predictor and recorded else {}
        seconds = self.signals[0].seconds
        if _prints_lines():
            name = self.name if recorded else None
            line = {"recording": name, "time": round(seconds, 6), "level": float(f"{level:.4g}")}
            print_line({**line, **{key: result[key] for key in KEYS if key in result}})
        clock = f"{seconds:.1f}/{self.settings.seconds:g} s" if recorded else "waiting for contact"
        label = result.get("label")
        said = f"{result['probability']:.2f} {label}" if label is not None else ""
        text = printable(f"{self.name}  {clock}  level {level:.3g}  {said}")
        self.status.update(Text(text, no_wrap=True, overflow="ellipsis"))

    def _keep(self) -> bool:
        """Write the recording, if it is long enough; return whether it is."""
        seconds = min(signal.seconds for signal in self.signals)
        if seconds < self.settings.least_seconds:
            if seconds:
                log.info("%.2f s are too short and not kept (record.least_seconds).", seconds)
            return False
        warnings: list[str] = []
        for signal in self.signals:
            warnings += signal.warnings(self.ranges.get(signal.modality, {}))
        if self.photo is not None:
            warnings += photo_quality(self.photo, {}, "photo").warnings
        samples = {signal.modality: (signal.rate, signal.samples) for signal in self.signals}
        _tell(self.folder.add(samples, self.photo), warnings, seconds=seconds)
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
