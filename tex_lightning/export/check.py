"""Recordings on which an exported file is checked against its classifier, and timed."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DataConfig, EngineConfig
from tex_lightning.core.progress import track
from tex_lightning.data.decode import Decoder, PhotoDecoder, to_size
from tex_lightning.data.folds import Sample, make_samples
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.store import Store, cache_root, load_recording
from tex_lightning.errors import UserError
from tex_lightning.export.graph import DRAWS
from tex_lightning.export.tracing import draws, example
from tex_lightning.inference.engine import accelerate
from tex_lightning.senses.base import Sense
from tex_lightning.senses.features.proportions import BandProportions

MADE_UP = "synthetic"  # data: no files are read
SHORTEST = 0.5  # of the example that is traced


@dataclass(frozen=True)
class Given:
    """A sample in the form of a file's inputs and of the classifier's, by modality.

    Attributes:
        raw: Signals at the rate of their sense, photos as they come out of their files.
        decoded: Photos halved where the card says so.
    """

    raw: dict[str, Tensor]
    decoded: dict[str, Tensor]


def recordings(data: DataConfig, classifier: SurfaceClassifier, count: int) -> list[Given]:
    """Usable samples of the data, evenly from all classes, or noise of as many sizes.

    Args:
        data: ``synthetic`` gives noise; anything else is read.
        classifier: Classifier that decodes.
        count: How many at most.

    Raises:
        UserError: If the data has no usable sample.
    """
    if data.name == MADE_UP:
        return [_decoded(_noise(classifier, seed), classifier) for seed in range(count)]
    rows = read_recordings(data, classifier.card.modalities)
    samples = make_samples(rows, classifier.card.modalities)
    store = Store(cache_root(data.cache_dir), _raw_decoders(data, classifier))
    found: list[Given] = []
    for sample in _spread(samples):
        if len(found) == count:
            break
        given = _loaded(sample, store, classifier)
        found += [] if given is None else [given]
    if count and not found:
        raise UserError(
            f"data={data.name} has no recording that the exported file could classify; give other "
            "data, or none."
        )
    return found


def _raw_decoders(data: DataConfig, classifier: SurfaceClassifier) -> dict[str, Decoder]:
    decoders = {}
    for sense in classifier.senses.values():
        decoder = sense.decoder.assuming(data.file_rate)
        if isinstance(decoder, PhotoDecoder):
            decoder = replace(decoder, half_scale=False)
        decoders[sense.modality] = decoder
    return decoders


def _spread(samples: Sequence[Sample]) -> list[Sample]:
    """Order samples: one of every class, then the next of every class."""
    seen: dict[str, int] = {}
    ranked = []
    for sample in samples:
        seen[sample.label] = seen.get(sample.label, -1) + 1
        ranked.append((seen[sample.label], sample))
    return [sample for _, sample in sorted(ranked, key=lambda each: each[0])]


def _loaded(sample: Sample, store: Store, classifier: SurfaceClassifier) -> Given | None:
    """A sample; None if it is damaged or too small."""
    try:
        given = {name: load_recording(row, store) for name, row in sample.recordings.items()}
        found = _decoded(given, classifier)
        for sense in classifier.senses.values():
            sense.check(found.decoded[sense.modality])
    except UserError:
        return None
    return found


def _noise(classifier: SurfaceClassifier, seed: int) -> dict[str, Tensor]:
    """Recordings of a size of their own; every second signal begins with quiet and a touch."""
    rng, found = np.random.default_rng(seed), {}
    for sense in classifier.senses.values():
        noise = example(sense, seed)
        if sense.medium == "signal":
            axes = 1 if seed % 4 < 2 else 3
            samples = round(noise.shape[1] * rng.uniform(SHORTEST, 2))
            noise = noise.repeat(1, 2)[:axes, :samples]
            if seed % 2:
                noise[:, : noise.shape[1] // 10] *= 1e-3
        else:
            height, width = noise.shape[:2]
            noise = noise.repeat(2, 2, 1)[: height + int(rng.integers(height)), : width + seed]
        found[sense.modality] = noise.contiguous()
    return found


def _decoded(raw: dict[str, Tensor], classifier: SurfaceClassifier) -> Given:
    return Given(
        raw, {b.modality: _as_decoded(b, raw[b.modality]) for b in classifier.senses.values()}
    )


def _as_decoded(sense: Sense, raw: Tensor) -> Tensor:
    decoder = sense.decoder
    if not isinstance(decoder, PhotoDecoder):
        return raw
    return torch.from_numpy(to_size(raw.numpy(), decoder, "The photo"))


Array = npt.NDArray[Any]
Runner = Callable[[Mapping[str, Array]], Mapping[str, Array]]  # inputs to outputs, by name
TOLERANCE = 1e-4  # of the range of a recording's scores
# The same where comparisons are counted: a few of thousands fall the other way by rounding, above
# all on training recordings, whose values the thresholds are. Against float64 PyTorch errs alike.
COUNTED = 0.05
WARM_UP = 2


@dataclass(frozen=True)
class Agreement:
    """Comparison of a file with its classifier.

    Attributes:
        recordings: How many were compared.
        same_labels: How many have the same label.
        score_difference: Largest difference of a score, as a share of its recording's range.
        probability_difference: Largest difference of a class probability.
        latency_ms: Median from decoded recordings to the label, of the file; None if none was
            compared.
        classifier_ms: The same of the accelerated classifier, interleaved in one process.
        ratio: Ratio of the first to the second.
    """

    recordings: int
    same_labels: int
    score_difference: float
    probability_difference: float
    latency_ms: float | None
    classifier_ms: float | None
    ratio: float | None

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self)


def compare(
    runner: Runner, classifier: SurfaceClassifier, samples: Sequence[Given], engine: EngineConfig
) -> Agreement:
    """Run a file and its classifier on the same recordings.

    Scores and labels are those of the classifier as it was loaded, times those of the accelerated
    one.
    """
    fast, same, scores, shares = accelerate(classifier, engine), 0, [0.0], [0.0]
    times: tuple[list[float], list[float]] = ([], [])
    for place, given in enumerate(track(samples, "Checking")):
        inputs = feed(classifier, given)
        with torch.inference_mode():
            expected = classifier.logits(**given.decoded)
            vote = classifier.decide(expected, classifier.card.temperature)
        for _ in range(0 if place else WARM_UP):
            runner(inputs), fast.classify(**given.decoded)
        begin = time.perf_counter()
        outputs = runner(inputs)
        middle = time.perf_counter()
        fast.classify(**given.decoded)
        times[0].append(middle - begin)
        times[1].append(time.perf_counter() - middle)
        wide = expected.double().numpy()
        scores.append(float(np.abs(outputs["scores"] - wide).max() / max(np.ptp(wide), 1e-12)))
        shares.append(float(np.abs(outputs["probabilities"] - vote.probabilities.numpy()).max()))
        same += int(outputs["label"]) == vote.label
    file_ms, own_ms = (1000 * statistics.median(each) if each else None for each in times)
    ratio = None if file_ms is None or own_ms is None else file_ms / own_ms
    return Agreement(len(samples), same, max(scores), max(shares), file_ms, own_ms, ratio)


def feed(classifier: SurfaceClassifier, given: Given) -> dict[str, Array]:
    """The inputs of a file, by name, so that a FusionNet draws the classifier's tuples."""
    inputs = {name: np.ascontiguousarray(each.numpy()) for name, each in given.raw.items()}
    if classifier.fusion is not None:
        card, seed = classifier.card, classifier.seed(**given.decoded)
        inputs[DRAWS] = draws(seed, card.decision["pairs"], len(card.sense_names)).numpy()
    return inputs


def tolerance(classifier: SurfaceClassifier) -> float:
    """Difference of scores, as a share of their range, that rounding explains."""
    senses = classifier.senses.values()
    counted = any(isinstance(sense.features, BandProportions) for sense in senses)
    return COUNTED if counted else TOLERANCE


def refuse(found: Agreement, allowed: float) -> None:
    """Raise an error if a file disagrees with its classifier.

    Raises:
        UserError: Saying how much.
    """
    wrong = found.recordings - found.same_labels
    if wrong or found.score_difference > allowed:
        raise UserError(
            f"The exported file gives another label for {wrong} of {found.recordings} recordings "
            f"and scores that differ by {found.score_difference:.2g} of their range, where "
            f"{allowed:g} is allowed; it was not written. Set export.check=0 to leave the check "
            "out, or report this network."
        )
