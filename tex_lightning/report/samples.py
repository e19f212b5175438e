"""Render a test sample to look at and to hear, with the class scores at every position.

Pictures are made without a plotting library, since a run shows dozens.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
import torch
from PIL import Image
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.devices import computing_threads
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.folds import Sample
from tex_lightning.data.store import Store, load_recording
from tex_lightning.evaluation.confusion import Pair, confused_pairs
from tex_lightning.evaluation.outcomes import Outcome
from tex_lightning.report.pictures import MAX_CAPTION, Pixels, captioned, input_pixels
from tex_lightning.report.style import brief
from tex_lightning.senses.base import Sense

WIDTH = 320  # pixels of a picture of a recording
HEIGHT = 64  # of a trace as drawn
STRIP = 18  # of the classes along a signal
PAIRS = 3  # most confused ones that are looked at
SECONDS = 5.0  # of a sound
MIN_RATE = 8000  # Hz; slower sounds are brought to it, as browsers play none below 3 kHz
TRUE, LABEL, OTHER = (0, 158, 115), (213, 94, 0), (200, 200, 200)  # Okabe and Ito; a light grey
TRACE = (0, 114, 178)
LEGEND = "fragments: green the true class, orange the label, grey others"


@dataclass(frozen=True)
class ShownSense:
    """One recording of a sample.

    Attributes:
        file: Name of its file.
        pictures: Each (height, width, 3): of a signal its ``trace`` as drawn; the ``input`` of the
            network, spectrogram or photo; and ``classes`` of the fragments: true, label or another.
        sound: Samples in [-1, 1] and their rate in Hz; None of a photo.
    """

    file: str
    pictures: Mapping[str, Pixels]
    sound: tuple[npt.NDArray[np.float32], int] | None


@dataclass(frozen=True)
class ShownSample:
    """One test sample: what became of it, and its recordings by name of the sense."""

    outcome: Outcome
    senses: Mapping[str, ShownSense]

    @property
    def title(self) -> str:
        """Truth, label and their probabilities."""
        outcome, known = self.outcome, self.outcome.class_probabilities
        label = f"{outcome.predicted} ({known.get(outcome.predicted, 0):.0%})"
        if outcome.correct:
            return f"{label}, correct"
        return f"{outcome.label} ({known.get(outcome.label, 0):.0%}) called {label}"


@torch.inference_mode()
def show_sample(
    classifier: SurfaceClassifier, sample: Sample, outcome: Outcome, store: Store
) -> ShownSample:
    """Look at one sample as a network does."""
    senses = {}
    for name, sense in classifier.senses.items():
        recording = load_recording(sample.recordings[sense.modality], store).to(classifier.device)
        with computing_threads(classifier.threads(name, recording)):
            fragments = classifier.fragment_scores(name, recording).argmax(dim=0).cpu()
        file = sample.recordings[sense.modality].path.name
        senses[name] = _shown(sense, file, recording, _colours(fragments, classifier, outcome))
    return ShownSample(outcome, senses)


@dataclass(frozen=True)
class SampleView:
    """The samples of a test and their outcomes, each rendered when it is first looked at.

    ``classifier_of`` returns the network that gave an outcome, such as that of its fold.
    """

    classifier_of: Callable[[Outcome], SurfaceClassifier]
    classes: Sequence[str]
    samples: Sequence[Sample]
    outcomes: Sequence[Outcome]
    store: Store
    _seen: dict[int, ShownSample] = field(default_factory=dict)

    def look(self, number: int) -> ShownSample:
        """Return the sample of a number as its network sees it."""
        if number not in self._seen:
            sample, outcome = self.samples[number], self.outcomes[number]
            classifier = self.classifier_of(outcome)
            self._seen[number] = show_sample(classifier, sample, outcome, self.store)
        return self._seen[number]

    @property
    def errors(self) -> int:
        """How many samples are misclassified."""
        return sum(not outcome.correct for outcome in self.outcomes)

    def pairs(self) -> list[tuple[Pair, list[int]]]:
        """Return the most confused pairs, each with the numbers of a sample of either class.

        Of all samples of its class it is the one that is most for the class that both are called.
        """
        return [
            (pair, [n for label in pair[:2] for n in self._most_for(pair.predicted, label)])
            for pair in confused_pairs(self.outcomes, self.classes)[:PAIRS]
        ]

    def _most_for(self, called: str, label: str) -> list[int]:
        def likely(number: int) -> tuple[bool, float]:
            outcome = self.outcomes[number]
            return outcome.predicted == called, outcome.class_probabilities.get(called, 0.0)

        own = [n for n, outcome in enumerate(self.outcomes) if outcome.label == label]
        return [max(own, key=likely)] if own else []


def _colours(fragments: Tensor, classifier: SurfaceClassifier, outcome: Outcome) -> Pixels:
    """Return the colour (rows, columns, 3) of each fragment."""
    classes = classifier.card.classes
    table = np.full((len(classes), 3), OTHER, np.uint8)
    for name, colour in ((outcome.predicted, LABEL), (outcome.label, TRUE)):
        if name in classes:
            table[classes.index(name)] = colour
    return np.asarray(table[fragments.numpy()])


def _shown(sense: Sense, file: str, recording: Tensor, colours: Pixels) -> ShownSense:
    if sense.medium == "photo":
        picture = Image.fromarray(recording.cpu().numpy())
        picture.thumbnail((WIDTH, WIDTH))
        size = picture.size
        map_ = Image.fromarray(colours).resize(size, Image.Resampling.NEAREST)
        pictures = {"input": np.asarray(picture), "classes": np.asarray(map_)}
        return ShownSense(file, pictures, None)
    signal = recording.cpu().float().numpy()
    spectrogram = Image.fromarray(input_pixels(sense(recording)[0], sense.features, 4 * WIDTH))
    strip = Image.fromarray(colours).resize((WIDTH, STRIP), Image.Resampling.NEAREST)
    height = max(HEIGHT, min(spectrogram.height, 2 * HEIGHT))
    pictures = {
        "trace": draw_trace(signal),
        "input": np.asarray(spectrogram.resize((WIDTH, height))),
        "classes": np.asarray(strip),
    }
    return ShownSense(file, pictures, _sound(signal, sense.decoder))


def draw_trace(signal: npt.NDArray[np.float32]) -> Pixels:
    """Draw a signal (axes, samples), the mean taken off, as its range in each column."""
    centred = signal - signal.mean(axis=1, keepdims=True)
    edges = np.linspace(0, signal.shape[1], WIDTH + 1).astype(int)
    starts = np.minimum(edges[:-1], signal.shape[1] - 1)
    low = np.minimum.reduceat(centred.min(axis=0), starts)
    high = np.maximum.reduceat(centred.max(axis=0), starts)
    scale = (HEIGHT / 2 - 1) / max(float(np.abs(centred).max()), 1e-12)
    rows = np.arange(HEIGHT)[:, None]
    top, bottom = HEIGHT / 2 - high * scale, HEIGHT / 2 - low * scale
    inside = (rows >= np.floor(top)) & (rows <= np.ceil(bottom))
    return np.where(inside[..., None], np.array(TRACE, np.uint8), np.uint8(255))


def _sound(
    signal: npt.NDArray[np.float32], decoder: object
) -> tuple[npt.NDArray[np.float32], int] | None:
    """Return the mean of the axes at full strength, and its rate."""
    if not isinstance(decoder, SignalDecoder):
        return None
    rate = decoder.sampling_rate
    samples = signal[:, : int(SECONDS * rate)].mean(axis=0)
    samples = samples - samples.mean()
    samples = samples / max(float(np.abs(samples).max()), 1e-12)
    if rate < MIN_RATE:
        times = np.arange(int(len(samples) * MIN_RATE / rate)) * rate / MIN_RATE
        samples, rate = np.interp(times, np.arange(len(samples)), samples), MIN_RATE
    return samples.astype(np.float32), round(rate)


def sample_picture(shown: ShownSample) -> Pixels:
    """Return a sample as one picture: as recorded, as the network gets it, what it made of it."""
    outcome, known = shown.outcome, shown.outcome.class_probabilities
    label, predicted = (
        f"{brief(name, MAX_CAPTION)} ({known.get(name, 0):.0%})"
        for name in (outcome.label, outcome.predicted)
    )
    told = [label, f"called {'so' if outcome.correct else predicted}"]
    rows: list[tuple[str, Sequence[Pixels]]] = [(line, ()) for line in told]
    for name, sense in shown.senses.items():
        first, *below = sense.pictures.values()
        rows.append((f"{name}: {sense.file}", [first]))
        rows += [("", [picture]) for picture in below]  # narrow, as columns of pages are
    return captioned([*rows, (LEGEND, ())])


def margin(outcome: Outcome) -> float:
    """Return by how much the best other class exceeds the true one, from -1 to 1."""
    known = dict(outcome.class_probabilities)
    true = known.pop(outcome.label, 0.0)
    return max(known.values(), default=0.0) - true


def worst(outcomes: Sequence[Outcome], most: int) -> list[int]:
    """Return the numbers of the outcomes that are most wrong, errors first, the worst first."""
    order = sorted(range(len(outcomes)), key=lambda n: (outcomes[n].correct, -margin(outcomes[n])))
    return order[:most]
