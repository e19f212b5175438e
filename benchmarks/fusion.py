"""What a fusion keeps where one modality is damaged, and what it gains where both are weak.

``python -m benchmarks fusion --data=DIR --part=damages --only=lmt16``, or ``--part=evidence``,
reads the folder ``--data`` or that in ``TEX_LIGHTNING_REAL_DATA``; ``fusion.yaml`` says what is
run. Recordings of two or three modalities are paired by class and number, arbitrarily: inside a
class they are unrelated. ``experiment=few/fusion`` is trained on the first recordings of each
class, or by a condition. Every later one is embedded once, and the same embeddings are scored by
each modality alone, by the plain sum of the scores, and by the fusion as it is. ``fusion.csv`` has
all counts, and McNemar's test of the fusion against the better modality.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from torch import Tensor, nn

import tex_lightning as tl
from benchmarks._changes import SPARE, TEST, TRAIN, Items, changed, find
from benchmarks._run import RESULTS
from benchmarks.accuracy import read_table
from benchmarks.shapes import chosen, load, write
from tex_lightning.classifier.classifier import SurfaceClassifier
from tex_lightning.core.console import console
from tex_lightning.core.files import write_rows
from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.recordings import Recordings
from tex_lightning.evaluation.comparison import mcnemar
from tex_lightning.inference.engine import accelerate
from tex_lightning.inference.predictor import Predictor

Embeddings = Mapping[str, Sequence[Tensor]]  # by modality, of each tested pair
SETTINGS = Path(__file__).with_suffix(".yaml")
COLUMNS = ("part", "pair", "change", "pairs", "haptic", "sound", "image", "sum", "fusion",
           "only_fusion", "only_better", "p")  # fmt: skip
SIDE = 128  # pixels of shrunk photos
OTHER = "other_class"  # a recording of another class


class Pairs(NamedTuple):
    """Recordings of each modality by number, paired."""

    train: Items
    test: dict[str, Items]


def measure(data: str = "", part: str = "", only: str = "", out: str = "") -> dict[str, Any]:
    """Measure the pairs that ``only`` names or begins; return counts in words."""
    settings = read_table(data, str(SETTINGS))
    rows: list[list[Any]] = []
    for kind in [part] if part else ["damages", "evidence"]:
        for name in chosen([*settings[kind]], only):
            rows += measure_pair(settings, kind, name)
    target = Path(out) if out else RESULTS
    write_rows(target / "fusion.csv", COLUMNS, rows)
    return {f"{row[1]}.{row[2]}": " ".join(map(str, row[3:])) for row in rows}


def measure_pair(settings: Mapping[str, Any], kind: str, name: str) -> list[list[Any]]:
    """Train one fusion; return a row for each change of its tested recordings."""
    entry = settings[kind][name]
    pairs = paired(settings, entry)
    predictor = trained(pairs.train)
    full = accelerate(predictor.classifier, predictor.config.engine)
    plain = accelerate(predictor.classifier, predictor.config.engine)
    plain.statistics = nn.ModuleDict()  # the sum of the scores
    clean = {modality: embedded(full, items) for modality, items in pairs.test.items()}
    labels = [full.card.classes.index(item.label) for item in next(iter(pairs.test.values()))]
    rows = [row_of(kind, name, "none", full, plain, clean, labels)]
    for modality, changes in (settings["changes"] if kind == "damages" else {}).items():
        for change, (function, value) in changes.items():
            items = damaged(pairs.test[modality], function, value)
            now = {**clean, modality: embedded(full, items)}
            rows.append(row_of(kind, name, f"{modality} {change}", full, plain, now, labels))
    return rows


def paired(settings: Mapping[str, Any], entry: Mapping[str, Any]) -> Pairs:
    """Read recordings of each modality, give them common labels, and pair the tested ones."""
    read: dict[str, Items] = {}
    for modality, source in entry["modalities"].items():
        items = [x for x in load({"data": settings["sources"]}, source) if x.part != SPARE]
        read[modality] = [replace(x, modality=modality) for x in items]
    count = min(len({x.label for x in items}) for items in read.values())
    train, test = Items(), dict[str, Items]()
    for modality, items in read.items():
        classes = {label: f"C{n}" for n, label in enumerate(sorted({x.label for x in items}))}
        common = [
            replace(x, label=classes[x.label], key=f"{modality}_{x.key}")
            for x in items
            if int(classes[x.label][1:]) < count
        ]
        common = shortened(common, entry.get(modality))
        train += [x for x in common if x.part == TRAIN]
        test[modality] = [x for x in common if x.part == TEST]
    return Pairs(train, _matched(test))


def shortened(items: Items, size: float | None) -> Items:
    """Cut signals to so many seconds in their middle, or leave photos so many pixels a side.

    They are enlarged again, to what the network needs.
    """
    if size is None:
        return items
    if items[0].rate:
        return changed(find("cut"), items, {"value": size}, np.random.default_rng(0))
    side = int(size)
    small = [cv2.resize(x.array, (side, side), interpolation=cv2.INTER_AREA) for x in items]
    large = [cv2.resize(array, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC) for array in small]
    return [replace(x, array=array) for x, array in zip(items, large, strict=True)]


def _matched(test: dict[str, Items]) -> dict[str, Items]:
    """Return as many recordings of each modality, those of a place being of one class.

    The modality with fewest recordings of a class says how many; no recording is in two pairs.
    """
    by = {m: {k: [x for x in items if x.label == k] for k in {y.label for y in items}}
          for m, items in test.items()}  # fmt: skip
    labels = sorted(set.intersection(*(set(x) for x in by.values())))
    counts = {label: min(len(x[label]) for x in by.values()) for label in labels}
    return {m: [x for k in labels for x in by[m][k][: counts[k]]] for m in test}


def trained(items: Items) -> Predictor:
    """Train on the recordings as the command line does."""
    with TemporaryDirectory() as name, console.capture():
        folder = Path(name)
        rows = tuple(write(item, folder) for item in items)
        write_manifest(Recordings(rows), folder / "all.csv")
        senses = {"haptic": "haptic", "sound": "sound", "image": "visual"}
        used = [
            sense
            for modality, sense in senses.items()
            if any(x.modality == modality for x in items)
        ]
        tl.train(
            "task=fit", "experiment=few/fusion", f"model.senses=[{','.join(used)}]",
            "data=manifest", f"data.manifest={folder}/all.csv", "data.test_fold=null",
            "data.half_scale=false", f"data.cache_dir={folder}/cache", "logger=csv", "verbose=0",
            f"hydra.run.dir={folder}/run",
        )  # fmt: skip
        return tl.load(str(folder / "run"))


def damaged(items: Items, function: str, value: Any) -> Items:  # noqa: ANN401
    """Return the recordings after a change, or in the place of each one of another class."""
    if function == OTHER:
        step = max(Counter(item.label for item in items).values())
        return [items[(n + step) % len(items)] for n in range(len(items))]
    return changed(find(function), items, {"value": value}, np.random.default_rng(7))


@torch.inference_mode()
def embedded(classifier: SurfaceClassifier, items: Items) -> list[Tensor]:
    """Return the embedding of every recording."""
    (name,) = (n for n, s in classifier.senses.items() if s.modality == items[0].modality)
    sense: Any = classifier.senses[name]
    embeddings = []
    for item in items:
        array = np.ascontiguousarray(item.array)
        if item.rate:
            decoded, _ = sense.resample(array.astype(np.float32), item.rate, {}, item.modality)
        else:
            decoded = torch.from_numpy(array)
        embeddings.append(classifier.embedding(name, decoded))
    return embeddings


@torch.inference_mode()
def row_of(
    kind: str,
    name: str,
    change: str,
    full: SurfaceClassifier,
    plain: SurfaceClassifier,
    embeddings: Embeddings,
    labels: Sequence[int],
) -> list[Any]:
    """Count the correct labels of each modality, of the sum and of the fusion."""
    correct: dict[str, list[bool]] = {}
    names = {sense.modality: n for n, sense in plain.senses.items()}
    for modality, rows in embeddings.items():
        alone = plain.with_senses([names[modality]])
        votes = (
            alone.vote({names[modality]: alone.output_of(names[modality], x)}, 0) for x in rows
        )
        correct[modality] = [vote.label == y for vote, y in zip(votes, labels, strict=True)]
    for title, classifier in (("sum", plain), ("fusion", full)):
        correct[title] = []
        for n, label in enumerate(labels):
            outputs = {
                names[m]: classifier.output_of(names[m], x[n]) for m, x in embeddings.items()
            }
            correct[title].append(classifier.vote(outputs, n).label == label)
    better = max(embeddings, key=lambda modality: sum(correct[modality]))
    first, second, p = mcnemar(correct["fusion"], correct[better])
    counts = [sum(correct[m]) if m in correct else "" for m in COLUMNS[4:9]]
    row = [kind, name, change, len(labels), *counts, first, second, f"{p:.2g}"]
    print(*row, flush=True)
    return row
