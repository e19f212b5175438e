"""Changes of the whole list of recordings that change no material, and how changes are applied.

A function with a parameter ``items`` takes and returns a list of :class:`Item`; every other one
takes a single signal or photo (``_spoilt.py``, and the package's perturbations).
"""

import inspect
import itertools
import zlib
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks import _spoilt
from tex_lightning.core.contract import resolve
from tex_lightning.perturbations import pixels, traces
from tex_lightning.perturbations.pixels import Scene
from tex_lightning_runtime.files import natural_key

Array = npt.NDArray[Any]
TRAIN, TEST, SPARE, ALL = "train", "test", "spare", "all"
VALUE, COUNT = "value", "count"  # keys of a step: its value, and how many items it changes


@dataclass(frozen=True)
class Item:
    """One recording of a data set that can be changed.

    Attributes:
        key: What pairs the outcomes of the changed and the unchanged recording.
        label: Class name.
        group: Group, as of a manifest.
        part: ``train``, ``test``, or ``spare``, which is in neither unless a change takes it.
        modality: ``haptic`` or ``image``.
        array: Signal (axes, samples) or photo (height, width, 3) uint8.
        rate: Hz; 0 of a photo.
    """

    key: str
    label: str
    group: int | str
    part: str
    modality: str
    array: Array
    rate: float = 0.0


Items = list[Item]


def apply(changes: Mapping[str, Any], items: Sequence[Item], name: str, kind: str = "") -> Items:
    """Apply steps to the training part, the tested part or both; without the spare ones.

    Args:
        changes: By part, ``train``, ``test`` or ``all``, the steps: values by function, or a
            mapping of ``value``, ``count`` (so many items by chance) and further arguments.
        items: All recordings.
        name: Of the shape; it seeds everything random.
        kind: Modality that is changed; empty for all.
    """
    result = list(items)
    for part, steps in changes.items():
        for function, given in steps.items():
            settings = dict(given) if isinstance(given, Mapping) else {VALUE: given}
            count = settings.pop(COUNT, None)
            rng = np.random.default_rng(zlib.crc32(f"{name}/{function}".encode()))
            fits = [x for x in result if part in (ALL, x.part) and kind in ("", x.modality)]
            if count is not None:
                fits = [fits[n] for n in np.sort(rng.choice(len(fits), count, replace=False))]
            chosen = {id(item) for item in fits}
            others = [item for item in result if id(item) not in chosen]
            result = [*others, *changed(find(function), fits, settings, rng)]
    return [item for item in result if item.part != SPARE]


def find(name: str) -> Callable[..., Any]:
    """Return a change of this module, one of the package's perturbations or a user's own."""
    known: dict[str, Any] = {**vars(pixels), **vars(traces), **vars(_spoilt), **globals()}
    function: Callable[..., Any] = known[name] if name in known else resolve("shapes", name)
    return function


def changed(
    function: Callable[..., Any], items: Items, settings: dict[str, Any], rng: np.random.Generator
) -> Items:
    """Return what a change makes of some recordings."""
    value, more = settings.get(VALUE), {k: v for k, v in settings.items() if k != VALUE}
    if "items" in inspect.signature(function).parameters:
        result: Items = function(items, value, rng, **more)
        return result
    seeds = rng.integers(1 << 32, size=len(items))
    return [
        replace(x, array=recorded(function(x.array, value, scene, **more), x.array))
        for x, scene in (
            (x, Scene(np.random.default_rng(s), x.rate)) for x, s in zip(items, seeds, strict=True)
        )
    ]


def recorded(array: Array, before: Array) -> Array:
    """Return a changed array as its sensor writes it: photos rounded, unless they have 16 bits."""
    if before.dtype != np.uint8 or array.dtype in (np.uint8, np.uint16):
        return array
    return np.rint(np.clip(array, 0, 255)).astype(np.uint8)


def by_class(items: Items, change: str, rng: np.random.Generator, low: float, high: float) -> Items:
    """Make a change with another value for each class, in equal ratios from ``low`` to ``high``."""
    names = sorted({item.label for item in items})
    values = dict(zip(names, np.geomspace(low, high, len(names)), strict=True))
    return [
        each
        for name in names
        for each in changed(
            find(change), [x for x in items if x.label == name], {VALUE: values[name]}, rng
        )
    ]


def shuffled(items: Items, value: None, rng: np.random.Generator) -> Items:
    """List the recordings in any order."""
    return [items[n] for n in rng.permutation(len(items))]


def at_rate(items: Items, factor: float, rng: np.random.Generator) -> Items:
    """Record at ``factor`` times the rate, with the filter that a converter has."""
    return [
        replace(
            x,
            array=traces.wrong_rate(x.array, 100 * (factor - 1), Scene(rng, x.rate)),
            rate=x.rate * factor,
        )
        for x in items
    ]


def clocks(items: Items, percent: float, rng: np.random.Generator) -> Items:
    """State rates that are wrong by up to so much, another for each recording."""
    return [replace(x, rate=x.rate * (1 + rng.uniform(-percent, percent) / 100)) for x in items]


def wrong_labels(items: Items, share: float, rng: np.random.Generator) -> Items:
    """Give a share of the recordings the name of another class."""
    names = sorted({item.label for item in items})
    wrong = {*rng.choice(len(items), round(share * len(items)), replace=False).tolist()}
    others = [[name for name in names if name != item.label] for item in items]
    return [
        replace(x, label=str(rng.choice(others[n]))) if n in wrong else x
        for n, x in enumerate(items)
    ]


def named(items: Items, kind: str, rng: np.random.Generator) -> Items:
    """Name the classes otherwise: by ``numbers``, or by ``odd`` text."""
    names = sorted({item.label for item in items})
    odd = ["1_0", "1e3", "true", "null", "été: #1", "a, b", "x=y", "{z}", "c/d", "名前"]
    other = {
        name: str(n) if kind == "numbers" else f"{odd[n % 10]}{' ' * (n > 9)}{n // 10 or ''}"
        for n, name in enumerate(names)
    }
    return [replace(item, label=other[item.label]) for item in items]


def one_group(items: Items, value: None, rng: np.random.Generator) -> Items:
    """Put all recordings into one session."""
    return [replace(item, group="monday") for item in items]


def group_a_class(items: Items, value: None, rng: np.random.Generator) -> Items:
    """Put every class into a session of its own."""
    return [replace(item, group=f"session {item.label}") for item in items]


def group_halves(items: Items, value: None, rng: np.random.Generator) -> Items:
    """Put the recordings of each class into two sessions in turn, the same for all classes."""
    turns: dict[tuple[str, str], Any] = defaultdict(lambda: itertools.cycle(("monday", "tuesday")))
    return [replace(item, group=next(turns[item.label, item.modality])) for item in items]


def group_uneven(items: Items, value: None, rng: np.random.Generator) -> Items:
    """Put one recording of each class into a second session, all others into the first."""
    last = {(item.label, item.modality): item.key for item in items}
    return [
        replace(x, group="tuesday" if last[x.label, x.modality] == x.key else "monday")
        for x in items
    ]


def group_each(items: Items, value: None, rng: np.random.Generator) -> Items:
    """Give every recording a group of its own."""
    return [replace(item, group=f"take {item.key}") for item in items]


def first(items: Items, count: int, rng: np.random.Generator, classes: float = 1.0) -> Items:
    """Train on the recordings of the first ``count`` groups of each class; what is tested stays.

    Args:
        items: Recordings, of which the spare ones may be taken, too.
        count: Number of groups.
        rng: Unused.
        classes: So many classes, or a share of them; the others stay as they are.
    """
    names = sorted({item.label for item in items})
    affected = {*names[: round(classes * len(names)) if isinstance(classes, float) else classes]}
    return _limited(items, dict.fromkeys(affected, count))


def unequal(items: Items, counts: Sequence[int], rng: np.random.Generator) -> Items:
    """Train on the first groups of each class, as many as ``counts`` has for it in turn."""
    names = sorted({item.label for item in items})
    return _limited(items, dict(zip(names, itertools.cycle(counts))))


def _limited(items: Items, counts: Mapping[str, int]) -> Items:
    pool: dict[tuple[str, str], set[str]] = defaultdict(set)
    for item in items:
        if item.part != TEST and item.label in counts:
            pool[item.label, item.modality].add(str(item.group))
    kept = {
        (*kind, group)
        for kind, groups in pool.items()
        for group in sorted(groups, key=natural_key)[: counts[kind[0]]]
    }
    parts = {True: TRAIN, False: SPARE}
    return [
        replace(x, part=parts[(x.label, x.modality, str(x.group)) in kept])
        if x.part != TEST and x.label in counts
        else x
        for x in items
    ]


def twice(items: Items, value: None, rng: np.random.Generator) -> Items:
    """List every recording a second time, as a copy in another group."""
    return [*items, *(replace(x, key=f"{x.key}_copy", group=f"copy {x.key}") for x in items)]


def joined(items: Items, seconds: float, rng: np.random.Generator, number: int = 2) -> Items:
    """Write so many strokes of a class into one file, with rest between them."""
    by_class: dict[str, Items] = defaultdict(list)
    for item in items:
        by_class[item.label].append(item)
    files = []
    for own in by_class.values():
        for begin in range(0, len(own), number):
            *before, last = own[begin : begin + number]
            arrays = [_spoilt.rest(x.array, seconds, Scene(rng, x.rate)) for x in before]
            files.append(replace(own[begin], array=np.concatenate([*arrays, last.array], axis=1)))
    return files
