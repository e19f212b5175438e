"""Accuracy on recordings of several sensors: systems by data sets by protocols.

``python -m benchmarks accuracy --data=DIR --out=DIR --only=fingertip20,few --choose=few,best``

``accuracy.yaml`` (or ``--table=FILE``) says what is run on the folder ``--data``, or that in
``TEX_LIGHTNING_REAL_DATA``. ``--only`` takes names of data sets, protocols and systems, or how they
begin. Each cell leaves a JSON file in ``--out`` and is run again only if it failed or its settings
changed; ``--limit`` gives up one after so many seconds. ``--choose`` names candidates, of which the
best one on all other data sets is reported. ``field.png`` is the picture of ``_field``.
"""

import json
import os
import signal
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from statistics import harmonic_mean
from tempfile import TemporaryDirectory
from typing import Any, NoReturn

import cv2
import numpy as np
import scipy
import yaml

import tex_lightning as tl
from benchmarks import _peers
from benchmarks._classifiers import configured
from benchmarks._field import best_peers, draw
from benchmarks._run import RESULTS
from tex_lightning.core.console import console
from tex_lightning.core.files import write_rows, write_text
from tex_lightning.core.run_folder import predictions_of
from tex_lightning.data.decode import SignalDecoder
from tex_lightning.data.folds import is_tested, next_of_each, with_folds
from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings, cut_part
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.outcomes import read_outcomes
from tex_lightning.perturbations.pixels import Scene
from tex_lightning.perturbations.table import perturbations
from tex_lightning.text import to_markdown

NORMAL = 1.959964  # deviations on either side of the mean that hold 95 %
NAMES = ("data", "protocol", "system")
COLUMNS = (*NAMES, "score", "balanced", "correct", "tested", "ci_low", "ci_high", "fit_seconds",
           "latency_ms", "failed")  # fmt: skip
SPLIT = "benchmark"  # condition of a manifest that says what is tested
Node = dict[str, Any]
Cell = tuple[str, str, str]
Rows = Sequence[tl.Recording]
Tested = list[tuple[str, str, float]]  # true class, predicted class, latency in ms
Trained = tuple[Tested, float]  # and seconds of the fit


def measure(
    data: str = "",
    out: str = "",
    only: str = "",
    choose: str = "",
    table: str = "",
    limit: str = "0",
) -> Node:
    """Run the cells that ``only`` names; return the score of each, and the choices."""
    settings = read_table(data, table)
    target = Path(out) if out else RESULTS / "accuracy"
    (target / "cells").mkdir(parents=True, exist_ok=True)
    cells = [
        (data_set, protocol, system)
        for data_set, entry in settings["data"].items()
        for protocol in entry["protocols"]
        for system in settings["systems"][entry["modality"]]
    ]
    results = [run(settings, cell, target, float(limit)) for cell in select(cells, only)]
    whole = [result for result in results if "score" in result]
    write_tables(results, target)
    draw(settings, whole, target / "field")
    figures = {".".join(result[name] for name in NAMES): shown(result) for result in results}
    best = best_peers(settings, whole).items()
    figures |= {name: f"{result['system']}, {shown(result)}" for name, result in best}
    candidates = list(dict.fromkeys(system for _, _, system in select(cells, choose)))
    return {**figures, **(choices(whole, candidates) if choose else {}), "in": str(target)}


def read_table(data: str, table: str = "") -> Node:
    """Return the settings of a table, with the folder of the data sets filled in."""
    folder = data or os.environ.get("TEX_LIGHTNING_REAL_DATA", "")
    if not folder or not Path(folder).is_dir():
        raise UserError("Give the folder of data sets by --data=DIR or TEX_LIGHTNING_REAL_DATA.")
    text = Path(table or Path(__file__).with_suffix(".yaml")).read_text(encoding="utf-8")
    settings: Node = yaml.safe_load(text.replace("$DATA", str(Path(folder).resolve())))
    return settings


def select(cells: list[Cell], only: str) -> list[Cell]:
    """Return the cells that are meant by names of each kind, or by how they begin."""
    words, known = only.split(",") if only else [], {name for cell in cells for name in cell}
    for word in words:
        if not any(name.startswith(word) for name in known):
            raise UserError(f"{word} begins no name; choose from {listed(sorted(known))}.")
    begun = tuple({*words} - known)
    names = {name for name in known if name in words or name.startswith(begun)}
    for kind in range(len(NAMES)):
        cells = [cell for cell in cells if cell[kind] in names] or cells
    return cells


def run(settings: Node, cell: Cell, target: Path, limit: float) -> Node:
    """Return the result of a cell: from its file, else measured."""
    data, protocol, system = cell
    result: Node = dict(zip(NAMES, cell, strict=True))
    entry, division = settings["data"][data], settings["protocols"][protocol]
    told = settings["systems"][entry["modality"]][system]
    try:
        parts = () if isinstance(told, dict) else parts_of(told)
        if "slow" in told:
            told = {**told, "every": entry.get("every", 1)}
        described = entry.get("keys"), entry.get("window"), division, told, parts
        digest = sha256(repr(described).encode()).hexdigest()[:8]
        file = target / "cells" / f"{data}-{protocol}-{system}-{digest}.json"
        if file.is_file():
            return {**json.loads(file.read_text(encoding="utf-8")), **result}
        with limited(limit):
            result |= test(settings["common"], entry, division, told)
    except Exception as error:  # the other cells are run, whatever it is
        return {**result, "failed": str(error) if isinstance(error, UserError) else repr(error)}
    write_text(file, json.dumps({**result, "system_settings": told}, indent=1) + "\n")
    print(*cell, shown(result), flush=True)
    return result


@contextmanager
def limited(seconds: float) -> Iterator[None]:
    """Give up some work after so many seconds; 0 sets no limit.

    Raises:
        UserError: Then, or as soon as compiled code comes back.
    """

    def stop(*_: object) -> NoReturn:
        raise UserError(f"It took more than {seconds:g} s; give --limit=SECONDS, or 0 for none.")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


def parts_of(overrides: list[str]) -> object:
    """Return the settings that tell a system of the package from another."""
    config = configured(*overrides)
    model = config.model
    return model.baseline or [*map(model.sense, model.senses), config.decision]


def test(common: list[str], entry: Node, division: Node, told: Node | list[str]) -> Node:
    """Train and test on every division; all of them are counted together.

    Args:
        common: Overrides of every system of the package.
        entry: The data set.
        division: The protocol.
        told: The system: overrides of the package, or what :mod:`benchmarks._peers` takes.
    """
    rows, keys, balanced = read_rows(entry), entry.get("keys", ()), entry.get("balanced", False)
    runs = []
    with TemporaryDirectory() as folder:
        changed = perturb(rows, division.get("perturbed", {}), Path(folder))
        for mask in divide(rows, division):
            mixed = [pair[out] for *pair, out in zip(rows, changed, mask, strict=True)]
            if isinstance(told, dict):
                runs.append(run_peer(told, mixed, keys, mask))
            else:
                runs.append(run_package([*common, *told, *keys], mixed, mask))
    tests = [prediction for tested, _ in runs for prediction in tested]
    correct = sum(label == predicted for label, predicted, _ in tests)
    rate = score(tests, balanced)
    low, high = interval(tests, balanced, division.get("times", 1))
    return {
        "score": rate, "balanced": balanced, "correct": correct,
        "tested": len(tests), "ci_low": low, "ci_high": high,
        "fit_seconds": float(np.mean([seconds for _, seconds in runs])),
        "latency_ms": float(np.median([latency for _, _, latency in tests])),
        "divisions": [score(tested, balanced) for tested, _ in runs],
    }  # fmt: skip


def score(tested: Tested, balanced: bool) -> float:
    """Return the share of correct predictions; balanced, the mean of those of each class."""
    correct = defaultdict(list)
    for label, predicted, _ in tested:
        correct[label if balanced else ""].append(label == predicted)
    return float(np.mean([np.mean(hits) for hits in correct.values()]))


def interval(tested: Tested, balanced: bool, times: int = 1) -> tuple[float, float]:
    """Return Wilson's 95 % interval of the score.

    The balanced score of classes of n recordings varies about as that of so many recordings in
    all, were they equal: the classes times the harmonic mean of n. Those that are tested several
    ``times``, after training on others, are no more recordings for that.
    """
    counts = [*Counter(label if balanced else "" for label, _, _ in tested).values()]
    size, share = len(counts) * harmonic_mean(counts) / times, score(tested, balanced)
    z = NORMAL
    centre = share + z**2 / (2 * size)
    half = z * (share * (1 - share) / size + z**2 / (4 * size**2)) ** 0.5
    low, high = ((centre + side * half) / (1 + z**2 / size) for side in (-1, 1))
    return max(0.0, low), min(1.0, high)


def read_rows(entry: Node) -> Rows:
    """Read the recordings of a data set, cut to the window in their middle if it has one."""
    modality, window = entry["modality"], entry.get("window")
    config = configured(*entry["reads"], *entry.get("keys", ())).data
    rows: Rows = read_recordings(config).of(entry.get("from", modality)).rows
    if window:
        read = [SignalDecoder().read(row.path, row.sampling_rate)[0] for row in rows]
        sizes = [trace.shape[1] for trace in read]
        spans = [((n - window) // 2 / n, (n + window) // 2 / n) for n in sizes]
        rows = [replace(row, part=span) for row, span in zip(rows, spans, strict=True)]
    return [replace(row, modality=modality, fold=None) for row in rows]


def divide(rows: Rows, division: Node) -> list[list[bool]]:
    """Return for every division which rows are tested; the others are trained on."""
    kind, value = next(iter(division.items()))
    if kind == "folds":
        folds = [row.fold for row in with_folds(Recordings(tuple(rows)), value)]
        return [[fold == tested for fold in folds] for tested in sorted({*folds})]
    if kind == "first":
        firsts = {*next_of_each([replace(row, fold=0) for row in rows], value, fold=0, folds=1)}
        return [[row not in firsts for row in rows]]
    if kind == "drawn":
        return [drawn(rows, value, np.random.default_rng(n)) for n in range(division["times"])]
    return [[bool(is_tested(row, conditions)) for row in rows] for conditions in value]


def drawn(rows: Rows, count: int, rng: np.random.Generator) -> list[bool]:
    """Return which rows are tested: all but so many of each class by chance."""
    numbers = defaultdict(list)
    for number, row in enumerate(rows):
        numbers[row.label].append(number)
    trained = {n for those in numbers.values() for n in rng.permutation(those)[:count].tolist()}
    return [number not in trained for number in range(len(rows))]


def perturb(rows: Rows, changes: Node, folder: Path) -> Rows:
    """Write photos perturbed in turn at the severities of ``changes``; without any return them."""
    if not changes:
        return rows
    changed = []
    for number, row in enumerate(rows):
        photo, path = cv2.imread(str(row.path))[..., ::-1], folder / f"{number}.png"
        for name, severity in changes.items():
            scene = Scene(np.random.default_rng(number), 0)
            photo = perturbations()[name].apply(photo, severity, scene)
        cv2.imwrite(str(path), photo[..., ::-1])
        changed.append(replace(row, path=path))
    return changed


def run_package(overrides: list[str], rows: Rows, is_test: list[bool]) -> Trained:
    """Train and test a system of the package; return its predictions and the seconds of the fit."""
    told = [
        replace(row, conditions=(*row.conditions, (SPLIT, "test" if tested else "train")))
        for row, tested in zip(rows, is_test, strict=True)
    ]
    with TemporaryDirectory() as folder, console.capture():
        manifest = Path(folder) / "manifest.csv"
        write_manifest(Recordings(tuple(told)), manifest)
        data = ("data=manifest", f"data.manifest={manifest}", f"data.test_where={{{SPLIT}: test}}")
        results = tl.train(*overrides, *data, f"hydra.run.dir={folder}/run")
        *_, (name, network) = results["networks"].items()
        outcomes = read_outcomes(predictions_of(results.folder, name))
    return [(x.label, x.predicted, x.latency_ms) for x in outcomes], network["fit_seconds"]


def run_peer(told: Node, rows: Rows, keys: Sequence[str], is_test: list[bool]) -> Trained:
    """Do the same with a classifier of another library."""
    signals = read_signals(rows, keys)
    return _peers.train(
        told, signals, [row.label for row in rows], [row.group_key for row in rows], is_test
    )


def read_signals(rows: Rows, keys: Sequence[str]) -> list[_peers.Signal]:
    """Return samples (axes, samples) and rate in Hz of each recording, or photos and 1."""
    if rows[0].modality == "image":
        return [(cv2.imread(str(row.path))[..., ::-1].copy(), 1.0) for row in rows]
    decoder, signals = SignalDecoder(channels=configured(*keys).data.channels), []
    for row in rows:
        trace, rate, _ = decoder.read(row.path, row.sampling_rate)
        signals.append((cut_part(trace, row.part, row.path), rate))
    return signals


def choices(results: list[Node], candidates: list[str]) -> dict[str, str]:
    """Name for each data set the candidate that is best on all the others, and its score there."""
    scores: dict[str, dict[str, list[float]]] = defaultdict(lambda: defaultdict(list))
    for result in results:
        scores[result["data"]][result["system"]].append(result["score"])
    sets = [name for name, by_system in scores.items() if by_system.keys() >= {*candidates}]
    means = np.array([[np.mean(scores[data][name]) for name in candidates] for data in sets])
    ranks = scipy.stats.rankdata(-means, axis=1)
    best = (ranks.sum(axis=0) - ranks).argmin(axis=1)
    return {
        f"chosen without {data}": f"{candidates[n]}, {row[n]:.1%} of at most {row.max():.1%}"
        for data, row, n in zip(sets, means, best, strict=True)
    }


def shown(result: Node) -> str:
    """Return the score of a result in words."""
    text = "{score:.1%} ({correct}/{tested}), fit {fit_seconds:.1f} s, {latency_ms:.1f} ms"
    return f"failed: {result['failed']}" if "failed" in result else text.format(**result)


def write_tables(results: list[Node], target: Path) -> None:
    """Write a row for each result as CSV and Markdown."""
    rows = [[result.get(name, "") for name in COLUMNS] for result in results]
    write_rows(target / "accuracy.csv", COLUMNS, rows)
    cells = [[f"{x:.4g}" if isinstance(x, float) else to_markdown(str(x)) for x in y] for y in rows]
    lines = [COLUMNS, ["---"] * len(COLUMNS), *cells]
    write_text(target / "accuracy.md", "".join(f"| {' | '.join(line)} |\n" for line in lines))
