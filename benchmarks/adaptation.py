"""What helps band proportions under new conditions: other speeds in training, unlabelled tests.

``python -m benchmarks adaptation --data=DIR --only=fabricslide,new_speed``

It runs the divisions of ``accuracy.yaml`` without the package's own training, so that features are
computed once for all ways of using them. ``warp`` adds every training recording at 3/4 and 4/3 of
its speed. ``centred`` moves the mean features of the tested recordings to those of the training.
``taught`` fits the network twice more, with the half of the tested recordings of each predicted
class that is the most certain; ``taught_half`` does so where the tested recordings have only the
first half of the classes.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy
import torch
from torch import Tensor

from benchmarks._classifiers import configured
from benchmarks.accuracy import (
    Rows,
    Tested,
    divide,
    read_rows,
    read_signals,
    read_table,
    score,
    select,
)
from tex_lightning.data.own_defaults import PAPERS_RATE, SLOW_RATE
from tex_lightning.networks.linear import LinearNet
from tex_lightning.senses.features.proportions import BandProportions
from tex_lightning_runtime.resampling import to_rate

SPEEDS = (0.75, 4 / 3)
ROUNDS = 2
Mask = np.ndarray[Any, np.dtype[np.bool_]]
Items = list[tuple[Tensor, int, str]]  # features (1, D, fragments), class and group


def measure(data: str = "", only: str = "") -> dict[str, Any]:
    """Return the score of every way, by data set and protocol."""
    settings, figures = read_table(data), {}
    sets = {name: x for name, x in settings["data"].items() if x["modality"] == "haptic"}
    cells = [(name, protocol, "") for name, x in sets.items() for protocol in x["protocols"]]
    for name, protocol, _ in select(cells, only):
        rows, tests = read_rows(sets[name]), defaultdict(list)
        signals, rate = at_one_rate(rows, sets[name].get("keys", ()))
        for mask in divide(rows, settings["protocols"][protocol]):
            for way, tested in compare(rows, signals, rate, np.array(mask)).items():
                tests[way] += tested
        for way, tested in tests.items():
            correct = sum(label == predicted for label, predicted, _ in tested)
            share = score(tested, sets[name].get("balanced", False))
            figures[f"{name}.{protocol}.{way}"] = f"{share:.1%} ({correct}/{len(tested)})"
            print(name, protocol, way, figures[f"{name}.{protocol}.{way}"], flush=True)
    return figures


def at_one_rate(rows: Rows, keys: Sequence[str]) -> tuple[list[Tensor], float]:
    """Return the signals (axes, samples) at their highest rate in Hz, at most the paper's."""
    read = read_signals(rows, keys)
    highest = min(PAPERS_RATE, max(rate for _, rate in read))
    signals = [to_rate(trace.astype(np.float32), rate, highest, "") for trace, rate in read]
    return [torch.from_numpy(np.array(signal, np.float32)) for signal in signals], highest


@torch.no_grad()
def compare(rows: Rows, signals: list[Tensor], rate: float, is_test: Mask) -> dict[str, Tested]:
    """Train on some of the recordings, and test the others in every way."""
    node = configured("experiment=few/haptic").model.haptic.features
    levels = len(signals[0]) if rate < SLOW_RATE else None
    values = {key: value for key, value in node.items() if key not in ("_target_", "levels")}
    features = BandProportions(sampling_rate=rate, skip_impact=True, levels=levels, **values)
    train, test = np.flatnonzero(~is_test), np.flatnonzero(is_test)
    features.learn(signals[n] for n in train)
    names = sorted({row.label for row in rows})
    labels, groups = [names.index(row.label) for row in rows], [row.group_key for row in rows]
    known: Items = [(features(signals[n])[0], labels[n], groups[n]) for n in train]
    warped = [
        (features(scale_time(signals[n], speed))[0], labels[n], groups[n])
        for n in train
        for speed in SPEEDS
    ]
    tested = torch.stack([features(signals[n])[0].mean(dim=-1, keepdim=True) for n in test])
    shift = torch.stack([item[0].mean(dim=-1, keepdim=True) for item in known]).mean(dim=0)
    half = np.array([labels[n] < len(names) / 2 for n in test])
    network = fitted(features, len(names), known)
    plain = network(tested)
    ways = {
        "plain": (plain, test),
        "warp": (fitted(features, len(names), known + warped)(tested), test),
        "centred": (network(tested - tested.mean(dim=0) + shift), test),
        "taught": (taught(features, network, known, tested), test),
        "plain_half": (plain[half], test[half]),
        "taught_half": (taught(features, network, known, tested[half]), test[half]),
    }
    return {
        way: [(rows[n].label, names[c], 0.0) for n, c in zip(which, labels, strict=True)]
        for way, (scores, which) in ways.items()
        for labels in [scores[..., 0].argmax(dim=1).tolist()]
    }


def fitted(features: BandProportions, classes: int, items: Items) -> LinearNet:
    """Return the network fitted to recordings."""
    network = LinearNet(classes, bands=features.bands, blocks=features.blocks)
    inputs, labels, groups = zip(*items, strict=True)
    network.fit(inputs, torch.tensor(labels), groups)
    return network


def taught(features: BandProportions, network: LinearNet, known: Items, tested: Tensor) -> Tensor:
    """Return the scores of tested recordings (recordings, 1, D, 1) that teach the network, too."""
    found = network(tested)[..., 0]
    for part in range(1, ROUNDS + 1):
        best, labels = found.topk(2, dim=1).values, found.argmax(dim=1)
        items = list(known)
        for label in labels.unique().tolist():
            members = (labels == label).nonzero()[:, 0]
            certain = members[(best[members, 0] - best[members, 1]).argsort(descending=True)]
            count = -(-len(members) * part // (2 * ROUNDS))
            items += [(tested[n], label, f"tested {n}") for n in certain[:count].tolist()]
        found = fitted(features, network.classes, items)(tested)[..., 0]
    return found[..., None]


def scale_time(signal: Tensor, factor: float) -> Tensor:
    """Return a signal (axes, samples) that lasts ``factor`` times as long."""
    length = int(signal.shape[1] * factor)
    return torch.from_numpy(scipy.signal.resample(signal.numpy(), length, axis=1))
