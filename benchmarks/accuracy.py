"""Accuracy on recordings of several sensors: systems by data sets by protocols.

``python -m benchmarks accuracy --data=DIR --out=DIR --only=fingertip20,few --choose=few,best``

``accuracy.yaml`` (or ``--table=FILE``) says what is run on the folder ``--data``, or that in
``TEX_LIGHTNING_REAL_DATA``. ``--only`` takes names of data sets, protocols and systems, or how they
begin. Each cell leaves a JSON file in ``--out`` and is run again only if it failed or its settings
changed. ``--choose`` names candidates, of which the best one on all other data sets is reported.
"""

import json
import os
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import replace
from hashlib import sha256
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import cv2
import numpy as np
import scipy
import yaml
from sklearn.linear_model import RidgeClassifierCV
from sklearn.model_selection import PredefinedSplit
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import tex_lightning as tl
from benchmarks._classifiers import configured
from benchmarks._run import RESULTS
from tex_lightning.core.console import console
from tex_lightning.core.files import write_rows, write_text
from tex_lightning.core.groups import leave_out
from tex_lightning.data.decode import SignalDecoder, read_trace
from tex_lightning.data.folds import is_tested, next_of_each, with_folds
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.recordings import Recordings, cut_part, write_manifest
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.outcomes import read_outcomes, wilson_interval
from tex_lightning.perturbations.pixels import Scene
from tex_lightning.perturbations.table import perturbations
from tex_lightning.report.figures import make_grid, save_figure
from tex_lightning.report.style import looks, styled
from tex_lightning.text import to_markdown

NAMES = ("data", "protocol", "system")
COLUMNS = (*NAMES, "score", "balanced", "correct", "tested", "ci_low", "ci_high", "fit_seconds",
           "latency_ms", "failed")  # fmt: skip
SPLIT = "benchmark"  # condition of a manifest that says what is tested
WINDOW, BANDS, FLOOR = 0.1, 24, 1e-10  # of log-band energies: s, number, power
AEON = "aeon="  # begins the override that names one of its classifiers
Array = np.ndarray[Any, Any]
Features = Callable[[Array, float], Array]  # of a signal (axes, samples) and its rate in Hz
Node = dict[str, Any]
Cell = tuple[str, str, str]
Rows = Sequence[tl.Recording]
Tested = list[tuple[str, str, float]]  # true class, predicted class, latency in ms


def measure(
    data: str = "", out: str = "", only: str = "", choose: str = "", table: str = ""
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
    results = [run(settings, cell, target) for cell in select(cells, only)]
    whole = [result for result in results if "score" in result]
    write_tables(results, target)
    draw(whole, target / "accuracy")
    figures = {".".join(result[name] for name in NAMES): shown(result) for result in results}
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


def run(settings: Node, cell: Cell, target: Path) -> Node:
    """Return the result of a cell: from its file, else measured."""
    data, protocol, system = cell
    result: Node = dict(zip(NAMES, cell, strict=True))
    entry, division = settings["data"][data], settings["protocols"][protocol]
    overrides = tuple(settings["systems"][entry["modality"]][system])
    try:
        parts = () if is_peer(overrides) else parts_of(overrides)
        described = entry.get("keys"), entry.get("window"), division, overrides, parts
        digest = sha256(repr(described).encode()).hexdigest()[:8]
        file = target / "cells" / f"{data}-{protocol}-{system}-{digest}.json"
        if file.is_file():
            return {**json.loads(file.read_text(encoding="utf-8")), **result}
        result |= test(settings["common"], entry, division, overrides)
    except Exception as error:  # the other cells are run, whatever it is
        return {**result, "failed": str(error) if isinstance(error, UserError) else repr(error)}
    write_text(file, json.dumps({**result, "overrides": overrides}, indent=1) + "\n")
    print(*cell, shown(result), flush=True)
    return result


def is_peer(overrides: Sequence[str]) -> bool:
    """Return whether a system is none of the package: the ridge, or a classifier of aeon."""
    return not overrides or overrides[0].startswith(AEON)


def parts_of(overrides: Sequence[str]) -> object:
    """Return the settings that tell a system of the package from another."""
    config = configured(*overrides)
    model = config.model
    return model.baseline or [*map(model.sense, model.senses), config.decision]


def test(common: list[str], entry: Node, division: Node, overrides: Sequence[str]) -> Node:
    """Train and test on every division; the interval is that of all counts together."""
    rows, keys, balanced = read_rows(entry), entry.get("keys", ()), entry.get("balanced", False)
    train, runs = run_peer if is_peer(overrides) else run_package, []
    with TemporaryDirectory() as folder:
        changed = perturb(rows, division.get("perturbed", {}), Path(folder))
        for mask in divide(rows, division):
            mixed = [pair[out] for *pair, out in zip(rows, changed, mask, strict=True)]
            runs.append(train([*common, *overrides, *keys], mixed, mask))
    tests = [prediction for tested, _ in runs for prediction in tested]
    correct = sum(label == predicted for label, predicted, _ in tests)
    low, high = wilson_interval(correct, len(tests))
    return {
        "score": score(tests, balanced), "balanced": balanced, "correct": correct,
        "tested": len(tests), "ci_low": low, "ci_high": high,
        "fit_seconds": float(np.mean([seconds for _, seconds in runs])),
        "latency_ms": float(np.median([latency for _, _, latency in tests])),
    }  # fmt: skip


def score(tested: Tested, balanced: bool) -> float:
    """Return the share of correct predictions; balanced, the mean of those of each class."""
    correct = defaultdict(list)
    for label, predicted, _ in tested:
        correct[label if balanced else ""].append(label == predicted)
    return float(np.mean([np.mean(hits) for hits in correct.values()]))


def read_rows(entry: Node) -> Rows:
    """Read the recordings of a data set, cut to the window in their middle if it has one."""
    modality, window = entry["modality"], entry.get("window")
    config = configured(*entry["reads"], *entry.get("keys", ())).data
    rows: Rows = read_recordings(config).of(entry.get("from", modality)).rows
    if window:
        read = [read_trace(row.path, SignalDecoder(), row.sampling_rate)[0] for row in rows]
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
    return [[bool(is_tested(row, conditions)) for row in rows] for conditions in value]


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


def run_package(overrides: list[str], rows: Rows, is_test: list[bool]) -> tuple[Tested, float]:
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
        outcomes = read_outcomes(results.folder / "predictions" / f"{name}.csv")
    return [(x.label, x.predicted, x.latency_ms) for x in outcomes], network["fit_seconds"]


def run_peer(overrides: list[str], rows: Rows, is_test: list[bool]) -> tuple[Tested, float]:
    """Do the same with a classifier of aeon, or with the ridge on log-band energies."""
    names = [item.removeprefix(AEON) for item in overrides if item.startswith(AEON)]
    signals = read_signals(rows, [item for item in overrides if not item.startswith(AEON)])
    train = np.flatnonzero(np.logical_not(is_test))
    labels, groups = zip(*((rows[n].label, rows[n].group_key) for n in train), strict=True)
    longest = max(signals[n][0].shape[1] for n in train)
    features, model = aeons(names[0], longest) if names else ridge_on_bands(labels, groups)
    begin = time.perf_counter()
    model.fit(np.stack([features(*signals[n]) for n in train]), np.array(labels))
    seconds, tested = time.perf_counter() - begin, []
    for n in np.flatnonzero(is_test):
        begin = time.perf_counter()
        predicted = str(model.predict(features(*signals[n])[None])[0])
        tested.append((rows[n].label, predicted, 1000 * (time.perf_counter() - begin)))
    return tested, seconds


def ridge_on_bands(labels: Sequence[str], groups: Sequence[str]) -> tuple[Features, Any]:
    """Return log-band energies and levels of every axis, and a ridge classifier for them."""
    left_out = leave_out(labels, groups) or None
    ridge = RidgeClassifierCV(np.logspace(-3, 4, 15), cv=left_out and PredefinedSplit(left_out))
    return log_bands, make_pipeline(StandardScaler(), ridge)


def aeons(name: str, length: int) -> tuple[Features, Any]:
    """Return signals as they are, of one length, and a classifier as ``module.Class`` of aeon."""
    module, _, cls = name.rpartition(".")
    model = getattr(import_module(f"aeon.classification.{module}"), cls)(random_state=0)
    return lambda trace, _: np.stack([np.resize(axis, length) for axis in trace]), model


def read_signals(rows: Rows, keys: Sequence[str]) -> list[tuple[Array, float]]:
    """Return the samples (axes, samples) and rate in Hz of every recording, as ``keys`` decode."""
    decoder, signals = SignalDecoder(channels=configured(*keys).data.channels), []
    for row in rows:
        trace, rate, _ = read_trace(row.path, decoder, row.sampling_rate)
        signals.append((cut_part(trace, row.part, row.path), rate))
    return signals


def log_bands(trace: Array, rate: float) -> Array:
    """Return means and deviations of log-band energies, and levels, of (axes, samples)."""
    size = min(trace.shape[1], max(32, round(WINDOW * rate)))
    frequencies, _, power = scipy.signal.spectrogram(trace, rate, nperseg=size, noverlap=size // 2)
    edges = np.geomspace(frequencies[1], rate / 2, BANDS, endpoint=False)
    starts = np.unique(np.searchsorted(frequencies, edges))
    bands = np.log(np.add.reduceat(power, starts, axis=1) + FLOOR)
    level = np.log(np.abs(trace.mean(axis=1)) + FLOOR**0.5)
    return np.concatenate((bands.mean(axis=2).ravel(), bands.std(axis=2).ravel(), level))


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


@styled
def draw(results: list[Node], path: Path) -> None:
    """Draw a chart for each data set: the score of every system by protocol."""
    sets = list(dict.fromkeys(result["data"] for result in results)) or [""]
    styles = looks(dict.fromkeys(result["system"] for result in results))
    figure, grid = make_grid(len(sets), 3, (3.6, 2.8))
    for axes, data in zip(grid, sets, strict=True):
        for system, (colour, marker) in styles.items():
            own = [r for r in results if (r["data"], r["system"]) == (data, system)]
            scores, names = [100 * r["score"] for r in own], [r["protocol"] for r in own]
            axes.plot(scores, names, marker, color=colour, label=system, alpha=0.7)
        axes.set(title=data, xlabel="correct (%)")
        axes.grid(axis="x")
    figure.legend(*grid[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    save_figure(figure, path)
