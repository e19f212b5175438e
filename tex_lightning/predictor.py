"""A trained system that classifies files and arrays, as the command line and Python use it."""

import time
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from tex_lightning.baselines.classifier import load_classifier
from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import CONF, Config
from tex_lightning.config.check import check_config
from tex_lightning.config.composition import compose_config
from tex_lightning.config.mistakes import MISTAKES, explain
from tex_lightning.config.weights import read_config
from tex_lightning.data.arrays import as_photo, as_trace
from tex_lightning.data.decode import decode_image, read_trace, to_rate
from tex_lightning.data.folds import NEEDS
from tex_lightning.data.quality import (
    Quality,
    TraceMonitor,
    photo_quality,
    together,
    trace_measures,
)
from tex_lightning.devices import pick_device, synchronise
from tex_lightning.errors import UserError
from tex_lightning.inference.early_stopping import prepare
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.streaming.live import LiveStream
from tex_lightning.parts import part_for
from tex_lightning.prediction import Prediction, describe
from tex_lightning.runfolder import find_checkpoint

Input = str | Path | np.ndarray[Any, Any] | Tensor | list[Any] | None
TASK = "predict"


def load(path: str | Path, *overrides: str) -> "Predictor":
    """Load a trained network or baseline.

    Args:
        path: A checkpoint or the run folder that holds it.
        *overrides: What ``task=predict`` takes on the command line, such as ``"top_k=5"``,
            ``"decision.reject_below=0.7"``, ``"engine=reference"``, ``"trainer.accelerator=cpu"``.

    Raises:
        UserError: If there is no such checkpoint, or an override cannot be meant.

    Example:
        >>> import tex_lightning as tl
        >>> model = tl.load("RUN", "top_k=2")
        >>> model.card.classes
        ['a', 'b', 'c']
    """
    return Predictor(load_classifier(find_checkpoint(path)), _compose(path, overrides))


def _compose(path: str | Path, overrides: tuple[str, ...]) -> Config:
    """The configuration that the command line would make."""
    try:
        composed = compose_config(CONF, [f"task={TASK}", *overrides])
    except MISTAKES as error:
        raise explain(error, overrides, CONF) from error
    composed.checkpoint = str(path)
    config = read_config(composed)
    check_config(config)
    return config


class Predictor:
    """A classifier with everything from files or arrays to a label around it.

    Args:
        classifier: As loaded.
        config: What ``task=predict`` or ``task=stream`` reads: engine, decision, device, ``top_k``.

    Attributes:
        card: What the checkpoint says of itself, such as ``card.classes``.

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
        self.classifier = classifier.to(pick_device(config.trainer.accelerator))
        self.card: Card = classifier.card.deciding(config.decision)
        self._deciders: dict[tuple[bool, bool], SurfaceClassifier] = {}

    def predict(
        self,
        haptic: Input = None,
        image: Input = None,
        *,
        rate: float | None = None,
        colour: str = "rgb",
    ) -> Prediction:
        """Classify one sample. Of a FusionNet one of the two is enough.

        Args:
            haptic: File of a trace, or its samples: (samples,), (axes, samples) or (samples, axes)
                with one or three axes, in the unit of the training recordings.
            image: File of a photo, or its pixels: (height, width, 3), or (height, width) in grey,
                uint8. Both are halved or resized as the checkpoint says.
            rate: Of the samples in Hz, and of a file that carries none; None takes the
                checkpoint's.
            colour: Order of the colours of an array, ``rgb`` or, as OpenCV has it, ``bgr``.

        Raises:
            UserError: If the input cannot be used, or is not what this checkpoint looks at.
        """
        self.check_senses(haptic=haptic is not None, image=image is not None)
        decider = self._decider(haptic is not None, image is not None)
        begin = time.perf_counter()
        try:
            trace, photo, quality = self._inputs(haptic, image, rate, colour)
            vote = decider.classify(trace, photo)
        except UserError as error:
            files = [str(each) for each in (haptic, image) if isinstance(each, str | Path)]
            named = not files or any(file in str(error) for file in files)
            raise UserError(str(error) if named else f"{' and '.join(files)}: {error}") from error
        synchronise(decider.device)
        latency, fused = time.perf_counter() - begin, self.card.kind == "fusion"
        said = NEEDS[decider.card.kind] if fused else ()
        return describe(vote, decider.card, quality, self.config.top_k, latency, said)

    def stream(self) -> LiveStream:
        """Begin a recording that is classified while it goes on.

        Raises:
            UserError: If this is no HapticNet, or its features need the whole recording.
        """
        engine = accelerate(self.classifier, self.config.engine)
        engine.card = self.card
        return LiveStream(engine, wait=self.config.stream.wait, top_k=self.config.top_k)

    def check_senses(self, *, haptic: bool, image: bool) -> None:
        """Refuse to be given nothing, or what this checkpoint does not look at.

        Raises:
            UserError: Naming it.
        """
        given = [key for key, there in (("haptic", haptic), ("image", image)) if there]
        unused = [key for key in given if key not in NEEDS[self.card.kind]]
        if not given:
            raise UserError("There is nothing to classify; give haptic, image or both.")
        if unused:
            raise UserError(
                f"This {self.card.title} does not look at {unused[0]}; leave {unused[0]}= "
                "out or give another checkpoint."
            )

    def _decider(self, haptic: bool, image: bool) -> SurfaceClassifier:
        """What decides on such a sample: of a FusionNet perhaps one part."""
        if (haptic, image) not in self._deciders:
            classifier = self.classifier
            if self.card.kind == "fusion" and not (haptic and image):
                classifier = part_for(classifier, "haptic" if haptic else "image")
            self._deciders[haptic, image] = prepare(
                classifier, self.config.engine, self.config.decision
            )
        return self._deciders[haptic, image]

    def _inputs(
        self, haptic: Input, image: Input, rate: float | None, colour: str
    ) -> tuple[Tensor | None, Tensor | None, Quality]:
        """Decoded trace and photo, and what is wrong with them."""
        trace = photo = None
        found: list[Quality] = []
        if haptic is not None:
            trace, quality = self._trace(haptic, rate)
            found.append(quality)
        if image is not None:
            photo, quality = self._photo(image, colour)
            found.append(quality)
        return trace, photo, together(found)

    def _trace(self, given: Input, rate: float | None) -> tuple[Tensor, Quality]:
        target = self.card.settings.sampling_rate
        rate = self.config.data.file_rate if rate is None else rate
        if isinstance(given, str | Path):
            path = Path(given).expanduser()
            raw, found = read_trace(path, self.card.settings_for(rate))
            source = found.hz
            name = f"Trace {path}"
        else:
            raw, source, name = as_trace(given), target if rate is None else rate, "haptic"
        if not source > 0:
            raise UserError(f"rate is {source:g}; give the sampling rate in Hz.")
        trace, monitor = to_rate(raw, source, target, name), TraceMonitor()
        monitor.update(raw)  # resampling would blur what is constant or clipped
        measures = trace_measures(trace, source, target)
        return torch.from_numpy(trace), monitor.quality(self.card.input_ranges, **measures)

    def _photo(self, given: Input, colour: str) -> tuple[Tensor, Quality]:
        settings = self.card.settings
        if isinstance(given, str | Path):
            fast = self.config.predict.fast_decode
            photo = decode_image(Path(given).expanduser(), settings, fast=fast)
        else:
            photo = as_photo(given, settings, colour)
        return torch.from_numpy(photo), photo_quality(photo, self.card.input_ranges)
