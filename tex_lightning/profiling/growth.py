"""How the cost of a decision grows: with the recording, the classes, the pairs, batch, threads."""

import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import dropwhile

import torch
from torch import Tensor

from tex_lightning.card import Card
from tex_lightning.classifier import SurfaceClassifier
from tex_lightning.config import EngineConfig, ProfileConfig
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.inference.engine import accelerate
from tex_lightning.networks.windows import scores
from tex_lightning.profiling.subject import Subject, like_weights, only_branch
from tex_lightning.profiling.timing import interleaved, waiting
from tex_lightning.threads import computing_threads

SIZES = {  # by the medium of a branch: seconds and megapixels
    "signal": (2.0, 5.0, 10.0, 20.0, 60.0, 120.0, 300.0, 600.0),
    "photo": (0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 48.0),
}
CLASSES = (10, 30, 69, 100, 300, 1000)
PAIRS = (10, 100, 1000, 10_000, 100_000)
BATCH = (1, 2, 4, 8, 16, 32, 64)
ASPECT = 4 / 3  # of a photo
ROUNDS = 9
SHARE = 0.1  # of the budget of a network's comparison, for each ladder


@dataclass(frozen=True)
class Point:
    """One measurement.

    Attributes:
        axis: What grows, with its unit.
        network: A sense, or fusion.
        part: What is timed: ``label`` (from the decoded recording), ``features`` or ``network``.
        value: How large.
        median_ms: None where it was left out.
        p95_ms: The same.
        note: Why it was left out, or empty.
    """

    axis: str
    network: str
    part: str
    value: float
    median_ms: float | None
    p95_ms: float | None
    note: str = ""


@dataclass(frozen=True)
class Ladder:
    """Values to measure in rising order, and how to get ready for one.

    ``prepare`` returns what is timed; its cost is expected to rise along a line at most.
    """

    axis: str
    network: str
    part: str
    values: tuple[float, ...]
    prepare: Callable[[float], Callable[[], object]]


def growth(
    subjects: list[Subject], fusion: Card | None, engine: EngineConfig, profile: ProfileConfig
) -> Iterator[Point]:
    """Measure all ladders, one after the other; the values of one take turns.

    Args:
        subjects: The unimodal networks and their recordings.
        fusion: Card of the FusionNet whose pairs are counted, if there is one.
        engine: How everything is accelerated.
        profile: ``max_seconds`` is the longest single call.
    """
    for subject in subjects:
        for ladder in _ladders(subject, engine):
            yield from climb(ladder, profile)
    if fusion is not None:
        yield from climb(_pairs_ladder(subjects, fusion, engine), profile)


def climb(ladder: Ladder, profile: ProfileConfig) -> list[Point]:
    """Measure a ladder up to the step that would take longer than ``profile.max_seconds``."""
    point = partial(Point, ladder.axis, ladder.network, ladder.part)
    functions: dict[float, Callable[[], object]] = {}
    left_out: list[Point] = []
    seen: list[tuple[float, float]] = []
    with torch.inference_mode():
        for value in ladder.values:
            expected = _expected(seen, value)
            if expected > profile.max_seconds:
                limit = f"profile.max_seconds is {profile.max_seconds:g}"
                left_out.append(point(value, None, None, f"about {expected:.1f} s, {limit}"))
                continue
            functions[value] = ladder.prepare(value)
            seen.append((value, _second_call(functions[value])))
        timings = interleaved(
            {str(value): function for value, function in functions.items()},
            ROUNDS,
            warm_up=0,
            budget_s=profile.budget_s * SHARE,
            slice_s=profile.budget_s * SHARE / 100,
        )
    done = [point(float(key), timing.median, timing.p95) for key, timing in timings.items()]
    return done + left_out


def _expected(seen: list[tuple[float, float]], value: float) -> float:
    """Seconds that a value will take: along the line through the last two; 0 for the first two."""
    if len(seen) < 2:
        return 0.0
    (early, before), (late, after) = seen[-2:]
    slope = max(0.0, (after - before) / (late - early))
    return after + slope * (value - late)


def _second_call(function: Callable[[], object]) -> float:
    """Seconds of a call that is not the first."""
    function()
    begin = time.perf_counter()
    function()
    return time.perf_counter() - begin


def _ladders(subject: Subject, engine: EngineConfig) -> Iterator[Ladder]:
    fast = accelerate(subject.classifier, engine)
    branch, device = only_branch(fast), fast.device
    name, axis = branch.name, f"{branch.what}, {branch.decoder.unit}"
    values = _sufficient(subject)

    def features(value: float) -> Callable[[], object]:
        larger = replace(subject, recording=_noise(subject, value))
        return waiting(lambda: larger.features(fast), device)

    def label(value: float) -> Callable[[], object]:
        return _decision(fast, _noise(subject, value))

    def classes(value: float) -> Callable[[], object]:
        names = [str(number) for number in range(round(value))]
        wide = SurfaceClassifier(replace(fast.card, classes=names)).eval().to(device)
        return _decision(accelerate(wide, engine), subject.recording)

    def batch(value: float) -> Callable[[], object]:
        window = branch.blank(*branch.window_size)
        x = torch.randn(round(value), *window.shape[1:])
        return waiting(partial(scores, branch.network, like_weights(branch.network, x)), device)

    def threads(value: float) -> Callable[[], object]:
        return _on_threads(_decision(fast, subject.recording), round(value))

    yield Ladder(axis, name, "features", values, features)
    yield Ladder(axis, name, "label", values, label)
    yield Ladder("classes", name, "label", CLASSES, classes)
    yield Ladder("windows in a batch", name, "network", BATCH, batch)
    if device.type == "cpu":
        cores = os.cpu_count() or 1
        counts = tuple(sorted({2**power for power in range(cores.bit_length())} | {cores}))
        yield Ladder("threads", name, "label", counts, threads)


def _noise(subject: Subject, value: float) -> Tensor:
    """A recording of so many seconds or megapixels, with as many axes as the subject's."""
    decoder = subject.branch.decoder
    if isinstance(decoder, SignalDecoder):
        return torch.randn(len(subject.recording), round(value * decoder.sampling_rate))
    height = round(math.sqrt(value * 1e6 / ASPECT))
    return torch.randint(256, (height, round(height * ASPECT), 3), dtype=torch.uint8)


def _sufficient(subject: Subject) -> tuple[float, ...]:
    """Seconds or megapixels that give a window of the network."""
    branch = subject.branch

    def too_small(value: float) -> bool:
        given = branch.input_size(_noise(subject, value))
        return any(have < least for have, least in zip(given, branch.window_size, strict=True))

    return tuple(dropwhile(too_small, SIZES[branch.medium]))


def _decision(classifier: SurfaceClassifier, recording: Tensor) -> Callable[[], object]:
    recordings = {only_branch(classifier).modality: recording}
    return lambda: classifier.classify(**recordings).label


def _on_threads(function: Callable[[], object], count: int) -> Callable[[], object]:
    def run() -> None:
        with computing_threads(count):
            function()

    return run


def _pairs_ladder(subjects: list[Subject], card: Card, engine: EngineConfig) -> Ladder:
    recordings = {subject.branch.modality: subject.recording for subject in subjects}
    device = subjects[0].classifier.device
    fast = accelerate(SurfaceClassifier(card).eval().to(device), engine)

    def pairs(value: float) -> Callable[[], object]:
        chosen = replace(card, decision={**card.decision, "pairs": round(value)})

        def run() -> int:
            fast.card = chosen
            return fast.classify(**recordings).label

        return run

    return Ladder("pairs K", card.kind, "label", PAIRS, pairs)
