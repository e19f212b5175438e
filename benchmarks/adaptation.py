"""What unlabelled recordings do: ``adapt`` with all that is tested, and with what could mislead it.

``python -m benchmarks adaptation --data=DIR --only=fabricslide,new_speed``

It runs the divisions of ``accuracy.yaml``. Each figure is the score before and after, how many
recordings of known classes are right, and in how many draws something was adapted. Beside ``all``
that is tested there are draws of parts: ``half`` of the classes, ``two`` of them or ``one``,
``ten`` recordings, and ``common``, where one class has ten times as many as each other. For
``unknown`` a class, for ``unknown_some`` a quarter of them, is left out of the training; how many
recordings of known classes are rejected then, and how many of unknown ones accepted, is counted
with the threshold of each checkpoint for 5 % of false rejections, where it has one. ``told`` is the
same with ``decision.unknown=0.05``: what is called unknown is not learnt from.
"""

import math
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch

import tex_lightning as tl
from benchmarks._peers import Signal
from benchmarks.accuracy import Tested, divide, read_rows, read_signals, read_table, score, select
from benchmarks.unknown import RATE
from tex_lightning.classifier.card import novelty_threshold
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.learning.adaptation import adapt

DRAWS = 3
Look = tuple[str, bool]  # class, and whether it is rejected
Labels = np.ndarray[Any, np.dtype[np.str_]]
Mask = np.ndarray[Any, np.dtype[np.bool_]]
Numbers = np.ndarray[Any, np.dtype[np.int64]]


class Drawn(NamedTuple):
    """What became of one draw."""

    before: Tested
    after: Tested
    adapted: bool
    rejections: Numbers  # (2, 2) before and after: of known ones, and accepted unknown ones
    unknown: int


def measure(data: str = "", only: str = "", table: str = "") -> dict[str, Any]:
    """Return the figures of every draw, by data set and protocol."""
    settings = read_table(data, table or str(Path(__file__).with_name("accuracy.yaml")))
    figures: dict[str, Any] = {}
    sets = {
        name: x for name, x in settings["data"].items()
        if x["modality"] == "haptic" and "from" not in x
    }  # fmt: skip
    cells = [(name, protocol, "") for name, x in sets.items() for protocol in x["protocols"]]
    for name, protocol, _ in select(cells, only):
        rows, drawn = read_rows(sets[name]), defaultdict(list)
        signals = read_signals(rows, sets[name].get("keys", ()))
        labels = np.array([row.label for row in rows])
        groups = np.array([row.group_key for row in rows])
        for number, mask in enumerate(divide(rows, settings["protocols"][protocol])):
            for kind, found in compare(signals, labels, groups, np.array(mask), number):
                drawn[kind].append(found)
        for kind, draws in drawn.items():
            told = figures[f"{name}.{protocol}.{kind}"] = shown(
                draws, sets[name].get("balanced", False)
            )
            print(name, protocol, kind, told, flush=True)
    return figures


def compare(
    signals: list[Signal], labels: Labels, groups: Labels, is_test: Mask, seed: int
) -> Iterator[tuple[str, Drawn]]:
    """Train on some of the recordings, and adapt to draws of the others."""
    rng, names = np.random.default_rng(seed), np.unique(labels)
    some = rng.choice(names, max(1, len(names) // 4), replace=False)
    for kind, absent in (("", []), ("unknown", some[:1]), ("unknown_some", some)):
        if len(names) - len(absent) < 2:
            continue
        train = np.flatnonzero(~is_test & ~np.isin(labels, absent))
        model = tl.Estimator("few/haptic").fit(
            [signals[n] for n in train], labels[train], groups[train]
        )
        tested = Recordings(model, [signals[n] for n in np.flatnonzero(is_test)], labels[is_test])
        if kind:
            every = np.arange(len(tested.labels))
            yield kind, tested.adapted(every)
            yield f"{kind}_told", tested.adapted(every, told=True)
            continue
        for kind_drawn, chosen in draw(tested.labels, rng):
            yield kind_drawn, tested.adapted(chosen)


def draw(labels: Labels, rng: np.random.Generator) -> Iterator[tuple[str, Numbers]]:
    """Yield which of the tested recordings are given."""
    names, counts = np.unique(labels, return_counts=True)
    yield "all", np.arange(len(labels))
    for _ in range(DRAWS):
        for kind, count in (("half", len(names) // 2), ("two", 2), ("one", 1)):
            chosen = rng.choice(names, count, replace=False)
            yield kind, np.flatnonzero(np.isin(labels, chosen))
        yield "ten", rng.choice(len(labels), min(10, len(labels)), replace=False)
        often = rng.choice(names)
        share = max(1, round(int(counts[names == often][0]) / 10))
        rare = [np.flatnonzero(labels == name) for name in names if name != often]
        few = [rng.permutation(members)[:share] for members in rare]
        yield "common", np.concatenate([np.flatnonzero(labels == often), *few])


class Recordings:
    """Tested recordings, whose features are computed once.

    Args:
        model: Trained.
        signals: Samples and rate in Hz of each.
        labels: Class of each; only :meth:`adapted` counts with them.
    """

    def __init__(self, model: tl.Estimator, signals: list[Signal], labels: Labels) -> None:
        predictor, self.labels = model.predictor_, labels
        self.classifier: SurfaceClassifier = predictor.classifier
        decoded = (predictor.decoded({"haptic": x}, rate=rate) for x, rate in signals)
        self.signals = [found["haptic"][0] for found in decoded]
        self.features = []
        for signal in self.signals:
            with torch.inference_mode():
                positions = self.classifier.embedding("haptic", signal)
                mean = positions.mean(dim=1, keepdim=True)
            self.features.append(mean.expand_as(positions))
        self.before = self.look(self.classifier)

    def look(self, classifier: SurfaceClassifier) -> list[Look]:
        """Return the class that each is taken for, and whether it is rejected."""
        limit = threshold(classifier)
        votes = (classifier.classify(haptic=signal) for signal in self.signals)
        return [(classifier.card.classes[vote.label], vote.novelty > limit) for vote in votes]

    def adapted(self, chosen: Numbers, *, told: bool = False) -> Drawn:
        """Return what becomes of some of them, those of unknown classes apart.

        ``told`` leaves out what is called unknown.
        """
        limit = threshold(self.classifier) if told else None
        found = adapt(self.classifier, [self.features[n] for n in chosen], limit)
        looks = self.before, self.before if found.reason else self.look(found.classifier)
        known = np.isin(self.labels[chosen], self.classifier.card.classes)
        before, after = (
            [(str(self.labels[n]), look[n][0], 0.0) for n in chosen[known]] for look in looks
        )
        rejected = np.array([[look[n][1] for n in chosen] for look in looks])
        counts = [(each[known].sum(), (~each[~known]).sum()) for each in rejected]
        return Drawn(before, after, not found.reason, np.array(counts), int((~known).sum()))


def threshold(classifier: SurfaceClassifier) -> float:
    """Return the novelty above which recordings are called unknown; none is without novelties."""
    known = classifier.card.known_novelties
    return novelty_threshold(known, RATE) if known else math.inf


def shown(draws: list[Drawn], balanced: bool) -> str:
    """Return the scores of all draws together, and the largest loss of one."""
    before, after = ([x for draw in draws for x in draw[place]] for place in (0, 1))
    right = [sum(label == found for label, found, _ in tested) for tested in (before, after)]
    shares = [score(tested, balanced) for tested in (before, after)]
    changes = [score(draw.after, False) - score(draw.before, False) for draw in draws]
    adapted = sum(draw.adapted for draw in draws)
    told = (
        f"{shares[0]:.1%} -> {shares[1]:.1%} ({right[0]} -> {right[1]} of {len(before)}), "
        f"adapted {adapted}/{len(draws)}, worst {100 * min(changes):+.1f} points"
    )
    unknown = sum(draw.unknown for draw in draws)
    false, accepted = sum(draw.rejections for draw in draws).T
    return told if not unknown else (
        f"{told}, false rejections {false[0]} -> {false[1]}, "
        f"accepted unknown {accepted[0]} -> {accepted[1]} of {unknown}"
    )  # fmt: skip
