"""Check an exported file against its classifier, and measure its time."""

import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig
from tex_lightning.errors import UserError
from tex_lightning.export.graph import DRAWS
from tex_lightning.export.recordings import Given
from tex_lightning.export.tracing import draws
from tex_lightning.features.proportions import BandProportions
from tex_lightning.inference.engine import accelerate
from tex_lightning.progress import track

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
        inputs[DRAWS] = draws(seed, card.decision["pairs"], len(card.senses)).numpy()
    return inputs


def tolerance(classifier: SurfaceClassifier) -> float:
    """Difference of scores, as a share of their range, that rounding explains."""
    branches = classifier.branches.values()
    counted = any(isinstance(branch.features, BandProportions) for branch in branches)
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
