"""Recordings on which an exported file is checked against its classifier."""

import random
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import islice
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.config import DataConfig
from tex_lightning.core.progress import track
from tex_lightning.data.decode import Decoder, PhotoDecoder
from tex_lightning.data.folds import make_samples
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recording
from tex_lightning.data.store import Store, cache_root, load_recording
from tex_lightning.errors import UserError
from tex_lightning.export.graph import DRAWS
from tex_lightning.export.tracing import draws, example
from tex_lightning.senses.features.proportions import BandProportions

MADE_UP = "synthetic"  # data: no files are read
SHORTEST = 0.5  # of the example that is traced
TOLERANCE = 1e-4  # of the range of a recording's scores
# The same where comparisons are counted: a few of thousands fall the other way by rounding, above
# all on training recordings, whose values the thresholds are. Against float64 PyTorch errs alike.
COUNTED = 0.05
Array = npt.NDArray[Any]
Sample = dict[str, Tensor]  # recordings by modality, as a file takes them
Runner = Callable[[Mapping[str, Array]], Mapping[str, Array]]  # inputs to outputs, by name


def check_samples(data: DataConfig, classifier: SurfaceClassifier, count: int) -> list[Sample]:
    """Return usable samples of the data, drawn at random, or noise of as many sizes.

    Args:
        data: ``synthetic`` gives noise; anything else is read.
        classifier: Classifier that decodes.
        count: How many at most.

    Raises:
        UserError: If the data has no usable sample.
    """
    if data.name == MADE_UP:
        return [_noise(classifier, seed) for seed in range(count)]
    samples = make_samples(
        read_recordings(data, classifier.card.modalities), classifier.card.modalities
    )
    decoders: dict[str, Decoder] = {}
    for sense in classifier.senses.values():
        decoder = sense.decoder.assuming(data.file_rate)
        if isinstance(decoder, PhotoDecoder):
            decoder = replace(decoder, half_scale=False)
        decoders[sense.modality] = decoder
    store = Store(cache_root(data.cache_dir), decoders)
    random.Random(0).shuffle(samples)  # so that the first come from many classes
    loaded = (_load(sample.recordings, store, classifier) for sample in samples)
    usable = list(islice(filter(None, loaded), count))
    if count and not usable:
        raise UserError(
            f"data={data.name} has no recording that the exported file could classify; give other "
            "data, or none."
        )
    return usable


def _load(rows: Mapping[str, Recording], store: Store, classifier: SurfaceClassifier) -> Sample:
    """Return a sample; empty if it is damaged or too small."""
    try:
        sample = {name: load_recording(row, store) for name, row in rows.items()}
        recordings = decoded(sample, classifier)
        for sense in classifier.senses.values():
            sense.check(recordings[sense.modality])
    except UserError:
        return {}
    return sample


def _noise(classifier: SurfaceClassifier, seed: int) -> Sample:
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


def decoded(sample: Sample, classifier: SurfaceClassifier) -> Sample:
    """Return the recordings as the classifier takes them: photos are halved."""
    result = dict(sample)
    for sense in classifier.senses.values():
        if isinstance(sense.decoder, PhotoDecoder):
            photo = sense.decoder.scale(sample[sense.modality].numpy(), "The photo")
            result[sense.modality] = torch.from_numpy(photo)
    return result


def compare(
    runner: Runner, classifier: SurfaceClassifier, samples: Sequence[Sample]
) -> dict[str, Any]:
    """Run a file and its classifier on the same recordings.

    Returns:
        Number of ``recordings`` and ``same_labels``; largest ``score_difference``, as a share of
        its recording's range, and ``probability_difference``; ``latency_ms``, the median from
        decoded recordings to the label of the file, None without recordings.
    """
    same, scores, shares, times = 0, [0.0], [0.0], []
    for sample in track(samples, "Checking"):
        recordings = decoded(sample, classifier)
        inputs = feed(classifier, sample, recordings)
        with torch.inference_mode():
            expected = classifier.logits(**recordings)
            vote = classifier.decide(expected, classifier.card.temperature)
        begin = time.perf_counter()
        outputs = runner(inputs)
        times.append(time.perf_counter() - begin)
        wide = expected.double().numpy()
        scores.append(float(np.abs(outputs["scores"] - wide).max() / max(np.ptp(wide), 1e-12)))
        shares.append(float(np.abs(outputs["probabilities"] - vote.probabilities.numpy()).max()))
        same += int(outputs["label"]) == vote.label
    return {
        "recordings": len(samples),
        "same_labels": same,
        "score_difference": max(scores),
        "probability_difference": max(shares),
        "latency_ms": 1000 * median(times) if times else None,
    }


def feed(classifier: SurfaceClassifier, sample: Sample, recordings: Sample) -> dict[str, Array]:
    """Return the inputs of a file by name, so that a FusionNet draws the classifier's tuples."""
    inputs = {name: np.ascontiguousarray(each.numpy()) for name, each in sample.items()}
    if classifier.fusion is not None:
        card, seed = classifier.card, classifier.seed(**recordings)
        inputs[DRAWS] = draws(seed, card.decision["pairs"], len(card.sense_names)).numpy()
    return inputs


def require_agreement(found: Mapping[str, Any], classifier: SurfaceClassifier) -> None:
    """Raise an error if a file disagrees with its classifier by more than rounding.

    Raises:
        UserError: Saying how much.
    """
    senses = classifier.senses.values()
    counts = any(isinstance(sense.features, BandProportions) for sense in senses)
    allowed = COUNTED if counts else TOLERANCE
    wrong = found["recordings"] - found["same_labels"]
    if wrong or found["score_difference"] > allowed:
        raise UserError(
            f"The exported file gives another label for {wrong} of {found['recordings']} "
            f"recordings and scores that differ by {found['score_difference']:.2g} of their range, "
            f"where {allowed:g} is allowed; it was not written. Set export.check=0 to leave the "
            "check out, or report this network."
        )
