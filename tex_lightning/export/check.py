"""Comparison of an exported file with its classifier, on recordings of noise."""

import time
from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.progress import track
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.errors import UserError
from tex_lightning.export.graph import DRAWS
from tex_lightning.export.tracing import draws, example
from tex_lightning.senses.features.proportions import BandProportions

SHORTEST = 0.5  # of the example that is traced
TOLERANCE = 1e-4  # of the range of a recording's scores
# The same where comparisons are counted: a few of thousands fall the other way by rounding, above
# all on training recordings, whose values the thresholds are. Against float64 PyTorch errs alike.
COUNTED = 0.05
Array = npt.NDArray[Any]
Sample = dict[str, Tensor]  # recordings by modality, as a file takes them
Runner = Callable[[Mapping[str, Array]], Mapping[str, Array]]  # inputs to outputs, by name


def noise_sample(classifier: SurfaceClassifier, seed: int) -> Sample:
    """Draw recordings of random sizes; every second signal begins with quiet and a touch."""
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
