"""Look for faults in a data set: leaks between groups, copies, and faults of a sensor.

Recordings that share anything belong into one group, or training and test do. That two share a
stretch shows in landmarks: the order of the samples around a local maximum, which neither gain nor
offset changes and which no other recording has by chance. Photos are compared in small, and then by
their details.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
import scipy

from tex_lightning.core.progress import track
from tex_lightning.data.decode import RATE_TOLERANCE, PhotoDecoder, SignalDecoder
from tex_lightning.data.recordings import Recording, Recordings, plural
from tex_lightning.data.store import Store, fingerprint
from tex_lightning_runtime.quality import (
    Survey,
    photo_measures,
    photo_quality,
    trace_measures,
    trace_quality,
)

Array = npt.NDArray[Any]
REACH = 64  # samples on each side that a landmark is the largest of
AROUND = 32  # samples on each side whose order tells one landmark from another
DISTINCT = 0.75  # of these samples, or the order is that of a coarse digitisation
COMMON = 8  # recordings with the same landmark: a tone, or what every recording begins with
SHARED = 4  # landmarks at the same distance that make a stretch
SMALL, LARGE = 24, 128  # pixels of a photo that is compared in small, and by its details
LIKE, SAME = 0.8, 0.85  # correlations of those
BLUR = 4.0  # pixels; what is coarser is light
MAX_PAIRS = 20_000  # of photos alike in small
MAX_NAMED = 3  # files of one finding
QUANTILES = (0.01, 0.99)  # of the training recordings, so that a few odd ones do not count


class Finding(NamedTuple):
    """A suspicion: its kind in one or two words, a sentence, and the files."""

    kind: str
    text: str
    files: str


def suspicions(recordings: Recordings, store: Store) -> list[Finding]:
    """Return everything that is suspected of decoded recordings, leaks first."""
    found = [*copies(recordings)]
    for modality in dict.fromkeys(row.modality for row in recordings):
        rows = [*recordings.of(modality)]
        signal = isinstance(store.decoders[modality], SignalDecoder)
        found += shared_stretches(rows, store) if signal else alike_photos(rows, store)
        found += faults(rows, store)
        found += mixtures(rows, store) if signal else ()
    return found


def copies(recordings: Recordings) -> Iterator[Finding]:
    """Yield files of the same content that are recordings of several groups."""
    alike: dict[tuple[str, str], list[Recording]] = defaultdict(list)
    for row in recordings:
        if row.part is None:
            alike[row.modality, fingerprint(row.path)].append(row)
    for rows in alike.values():
        if len({row.group_key for row in rows}) > 1:
            labels = {row.label for row in rows}
            more = f" of {len(labels)} classes" if len(labels) > 1 else ""
            yield Finding(
                "copies", f"{len(rows)} files{more} have the same content", named_files(rows)
            )


def shared_stretches(rows: Sequence[Recording], store: Store) -> Iterator[Finding]:
    """Yield pairs of signals of different groups that were cut from one, wholly or in part."""
    for (one, other), counts in sorted(_distances(rows, store).items()):
        distance, count = counts.most_common(1)[0]
        first, second = rows[one], rows[other]
        same = first.part is None and fingerprint(first.path) == fingerprint(second.path)
        if count < SHARED or same or first.group_key == second.group_key:
            continue
        lengths = store.shape(first)[1], store.shape(second)[1]
        begin, end = max(0, distance), min(lengths[0], lengths[1] + distance)
        rate = getattr(store.decoders[first.modality], "sampling_rate", 1.0)
        text = f"Two recordings of different groups share {(end - begin) / rate:.3g} s"
        yield Finding("shared stretch", text, named_files([first, second]))


def _distances(rows: Sequence[Recording], store: Store) -> dict[tuple[int, int], Counter[int]]:
    """Count by the numbers of two signals how many samples their common landmarks are apart."""
    places: dict[bytes, dict[int, int]] = defaultdict(dict)
    for number, row in enumerate(track(rows, f"Comparing {plural(rows[0].modality)}")):
        for order, place in _landmarks(store.load(row)).items():
            places[order][number] = place
    distances: dict[tuple[int, int], Counter[int]] = defaultdict(Counter)
    for by_number in places.values():
        pairs = combinations(sorted(by_number), 2) if len(by_number) <= COMMON else ()
        for one, other in pairs:
            distances[one, other][by_number[one] - by_number[other]] += 1
    return distances


def _landmarks(signal: Array) -> Mapping[bytes, int]:
    """Return the order of the samples around each local maximum of an axis, and its place.

    Args:
        signal: (axes, samples); the first axis that is not constant is looked at.
    """
    varying = np.flatnonzero(np.ptp(signal, axis=1) > 0)
    if not len(varying) or signal.shape[1] < 2 * REACH:
        return {}
    axis = np.asarray(signal[varying[0]])
    highest = scipy.ndimage.maximum_filter1d(axis, 2 * REACH + 1, mode="nearest") == axis
    found = np.flatnonzero(highest)
    found = found[(found >= AROUND) & (found < len(axis) - AROUND)]
    orders: dict[bytes, int] = {}
    repeated = set()
    for place in found.tolist():
        around = axis[place - AROUND : place + AROUND]
        if len(np.unique(around)) < DISTINCT * len(around):
            continue
        order = np.argsort(around, kind="stable").astype(np.uint8).tobytes()
        if order in orders:
            repeated.add(order)
        orders[order] = place
    return {order: place for order, place in orders.items() if order not in repeated}


def alike_photos(rows: Sequence[Recording], store: Store) -> Iterator[Finding]:
    """Yield sets of photos of several groups that show the same, at the same place."""
    ones, others = np.array(_similar_pairs(rows, store), int).reshape(-1, 2).T
    links = scipy.sparse.coo_array((np.ones(len(ones)), (ones, others)), (len(rows), len(rows)))
    _, labels = scipy.sparse.csgraph.connected_components(links, directed=False)
    for label in np.flatnonzero(np.bincount(labels) > 1):
        members = [rows[number] for number in np.flatnonzero(labels == label)]
        groups = {row.group_key for row in members}
        contents = {(fingerprint(row.path), row.part) for row in members}
        if len(groups) > 1 and len(contents) > 1:  # else it is a copy
            text = f"{len(members)} {plural(members[0].modality)} of {len(groups)} groups are alike"
            yield Finding("same picture", text, named_files(members))


def _similar_pairs(rows: Sequence[Recording], store: Store) -> list[tuple[int, int]]:
    """Return the numbers of every two photos that are alike in small, and by their details."""
    small, large = [], []
    for row in track(rows, f"Comparing {plural(rows[0].modality)}"):
        grey = np.asarray(store.load(row), np.float32).mean(axis=2)
        small.append(_standard(cv2.resize(grey, (SMALL, SMALL), interpolation=cv2.INTER_AREA)))
        details = cv2.resize(grey, (LARGE, LARGE), interpolation=cv2.INTER_AREA)
        large.append(_standard(details - cv2.GaussianBlur(details, (0, 0), BLUR)))
    likeness = np.triu(np.stack(small) @ np.stack(small).T, 1)
    return [
        (one, other)
        for one, other in np.argwhere(likeness > LIKE)[:MAX_PAIRS].tolist()
        if float(large[one] @ large[other]) > SAME
    ]


def _standard(picture: Array) -> npt.NDArray[np.float32]:
    """Return a picture (n, n) as (n²,) of mean 0 and length 1; zeros of a uniform one."""
    values = np.asarray(picture, np.float32).ravel()
    values = values - values.mean()
    length = float(np.linalg.norm(values))
    scale = 1 / length if length > 1e-3 * len(values) ** 0.5 else 0.0
    return np.asarray(values * np.float32(scale))


def faults(rows: Sequence[Recording], store: Store) -> Iterator[Finding]:
    """Yield a finding for each fault that recordings of one modality have: constant, clipped."""
    having: dict[str, list[tuple[Recording, str]]] = defaultdict(list)
    decoder = store.decoders[rows[0].modality]
    for row in rows:
        array = store.load(row)
        if isinstance(decoder, PhotoDecoder):
            quality = photo_quality(array, {}, "photo")
        else:
            quality = trace_quality(array, {}, plural(row.modality).removesuffix("s"), {})
        for warning in quality.warnings:
            having[_kind(warning)].append((row, warning))
    for kind, found in having.items():
        count = f"{len(found)} of {len(rows)} {plural(rows[0].modality)}; the first: "
        yield Finding(kind, count + found[0][1], named_files([row for row, _ in found]))


def _kind(warning: str) -> str:
    known = ("clipped", "silent", "constant", "uniform")
    kind = next((word for word in known if f"is {word}" in warning), "odd")
    return "constant axis" if warning.startswith("Axis") else kind


def mixtures(rows: Sequence[Recording], store: Store) -> Iterator[Finding]:
    """Yield findings for signals of different rates, or numbers of axes."""
    rates: dict[float, list[Recording]] = defaultdict(list)
    axes: dict[float, list[Recording]] = defaultdict(list)
    lowest = 0.0
    for row in sorted(rows, key=store.rate):
        if store.rate(row) > lowest * (1 + RATE_TOLERANCE):
            lowest = store.rate(row)
        rates[lowest].append(row)
        axes[store.shape(row)[0]].append(row)
    for kind, found, unit in (("mixed rates", rates, "Hz"), ("mixed axes", axes, "axes")):
        if len(found) > 1:
            most = sorted(found, key=lambda value: -len(found[value]))
            text = ", ".join(f"{len(found[value])} with {value:,.6g} {unit}" for value in most)
            yield Finding(kind, text, named_files([found[value][0] for value in most]))


def named_files(rows: Sequence[Recording]) -> str:
    """Name the first files of several, with their class."""
    named = [f"{row.label}/{row.path.name}" for row in rows[:MAX_NAMED]]
    more = [f"{len(rows) - MAX_NAMED} more"] if len(rows) > MAX_NAMED else []
    return ", ".join([*named, *more])


def training_ranges(rows: Iterable[Recording], store: Store) -> dict[str, list[float]]:
    """Measure training recordings of one modality: each measure's ends, by quantiles."""
    values: dict[str, list[float]] = defaultdict(list)
    for row in rows:
        decoder = store.decoders[row.modality]
        if isinstance(decoder, SignalDecoder):
            survey = Survey()
            survey.add(store.load(row))
            measures = trace_measures(store.level(row), store.rate(row), decoder.sampling_rate)
            measures |= survey.measures
        else:
            measures = photo_measures(store.load(row))
        for name, value in measures.items():
            values[name].append(value)
    return {name: np.quantile(numbers, QUANTILES).tolist() for name, numbers in values.items()}
