"""How accuracy keeps when one condition of the tested recordings is none of the training's.

``python -m benchmarks shifts --data=DIR [--only=fabricslide,few_haptic]``. A speed, force or
direction is left out; or the tested signals are changed: axes turned and offset as by another
mount, another gain, another clock, and, trained on recordings of two gains, a third gain. Of each
there is the mean and the worst of its divisions. Data sets are those of ``accuracy.yaml``.
"""

import json
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

import tex_lightning as tl
from benchmarks._run import RESULTS
from benchmarks.accuracy import divide, read_rows, read_signals, read_table, score, select
from tex_lightning.core.files import write_text

Array = np.ndarray
Change = Callable[[Array, int], Array]
CLOCKS, TURNS, GAINS = (0.95, 1.05), (30, 90), (0.1, 10.0)
THIRD = (0.25, 16.0)  # gains, where half of the training has 1 and half has 4
OFFSET = 1.0  # m/s^2, on each axis
BANDS, WINDOW = 24, 0.25  # of the log spectra, and s
SYSTEMS = ("few_haptic", "lda", "minirocket")
PLAIN, TWO_GAINS = "", "two gains"
DIVISIONS = {
    "fabricslide": {
        "new speed": {"tests": [{"speed": x} for x in (10, 20, 50, 100, 120, 150)]},
        "new force": {"tests": [{"force": x} for x in (120, 150, 180, 210, 250)]},
        "new direction": {"tests": [{"direction": "up"}, {"direction": "down"}]},
        "slow to fast": {"tests": [{"speed": [100, 120, 150]}]},
        "light to heavy": {"tests": [{"force": [180, 210, 250]}]},
    },
    "borealtc": {"new run": {"folds": 5}},
    "hapmat": {"new block": {"folds": 5}},
    "fingertip20": {"first 5": {"first": 5}},
    "lmt16": {"first 5": {"first": 5}},
}


def measure(data: str = "", out: str = "", only: str = "") -> dict[str, Any]:
    """Measure the cells that ``only`` names; return mean and worst accuracy of every shift."""
    settings, target = read_table(data, str(Path(__file__).with_name("accuracy.yaml"))), Path(out)
    target = target if out else RESULTS / "shifts"
    cells = [(name, shift, system) for name in DIVISIONS for shift in DIVISIONS[name]
             for system in SYSTEMS]  # fmt: skip
    figures: dict[str, Any] = {}
    for name, shift, system in select(cells, only):
        file = target / f"{name}-{shift.replace(' ', '_')}-{system}.json"
        if not file.is_file():
            shares = measure_cell(settings["data"][name], DIVISIONS[name][shift], system)
            write_text(file, json.dumps(shares, indent=1) + "\n")
            print(name, shift, system, shares, flush=True)
        figures[f"{name}.{shift}.{system}"] = {
            key: f"{np.mean(x):.1%}, worst {min(x):.1%}"
            for key, x in json.loads(file.read_text(encoding="utf-8")).items()
        }
    return figures


def measure_cell(entry: dict[str, Any], division: Any, system: str) -> dict[str, list[float]]:  # noqa: ANN401
    """Return the accuracies of all divisions as they are, and under each change of the tested."""
    rows = read_rows(entry)
    signals, rates = zip(*read_signals(rows, entry.get("keys", ())), strict=True)
    shares = defaultdict(list)
    for mask in divide(rows, division):
        classes = {row.label for row, out in zip(rows, mask, strict=True) if not out}
        train = [n for n, out in enumerate(mask) if not out]
        tests = [n for n, out in enumerate(mask) if out and rows[n].label in classes]
        labels, groups = [rows[n].label for n in train], [rows[n].group_key for n in train]
        inputs = [signals[n] for n in train]
        for gains, changes in plans(len(inputs[0]), alone="tests" in division):
            scaled = [4.0 ** (gains * (n % 2)) * x for n, x in enumerate(inputs)]
            predict = fit(system, scaled, labels, groups, rates[0])
            for name, change in changes:
                found = predict([change(signals[n], n) for n in tests])
                tested = [(rows[n].label, x, 0.0) for n, x in zip(tests, found, strict=True)]
                shares[name].append(score(tested, entry.get("balanced", False)))
    return shares


def plans(axes: int, *, alone: bool) -> Iterator[tuple[bool, list[tuple[str, Change]]]]:
    """Yield whether the training has two gains, and the changes of what is tested.

    Args:
        axes: Of a signal.
        alone: Whether the division is the shift, and nothing is changed.
    """
    changes: list[tuple[str, Change]] = [("as it is", lambda x, _: x)]
    if not alone:
        changes += [(f"gain {g:g}", lambda x, _, g=g: g * x) for g in GAINS]
        changes += [(f"clock {c:g}", lambda x, _, c=c: clocked(x, c)) for c in CLOCKS]
        if axes == 3:
            changes += [(f"turned by {t}", lambda x, n, t=t: turned(x, t, n)) for t in TURNS]
            changes.append(("offset", lambda x, _: x + OFFSET))
    yield False, changes
    if not alone:
        yield True, [(f"gain {g:g} of 1 and 4", lambda x, _, g=g: g * x) for g in THIRD]


def clocked(signal: Array, factor: float) -> Array:
    """Return a signal (axes, samples) as a clock that is faster by a factor samples it."""
    size = signal.shape[1]
    places = np.arange(int((size - 1) * factor) + 1) / factor
    return np.stack([np.interp(places, np.arange(size), axis) for axis in signal])


def turned(signal: Array, degrees: float, seed: int) -> Array:
    """Return a signal (3, samples) turned about an axis that is drawn."""
    axis = np.random.default_rng(seed % 5).standard_normal(3)
    vector = np.radians(degrees) * axis / np.linalg.norm(axis)
    matrix: Array = scipy.spatial.transform.Rotation.from_rotvec(vector).as_matrix()
    return matrix @ signal


def fit(
    system: str, signals: Sequence[Array], labels: list[str], groups: list[str], rate: float
) -> Callable[[Sequence[Array]], list[str]]:
    """Fit a system to signals (axes, samples), and return what it predicts."""
    if system == "lda":
        model = LinearDiscriminantAnalysis(solver="lsqr", shrinkage=0.01)
        line = make_pipeline(StandardScaler(), model)
        line.fit(np.stack([log_bands(x, rate) for x in signals]), labels)
        return lambda some: line.predict(np.stack([log_bands(x, rate) for x in some])).tolist()
    name = {"few_haptic": "few/haptic"}.get(system, system)
    estimator = tl.Estimator(name, rate=rate)
    estimator.fit([*signals], labels, groups=groups)
    return lambda some: [str(x) for x in estimator.predict([*some])]


def log_bands(signal: Array, rate: float) -> Array:
    """Return mean log-band energies and levels of (axes, samples)."""
    size = min(signal.shape[1], max(32, round(WINDOW * rate)))
    frequencies, _, power = scipy.signal.spectrogram(signal, rate, nperseg=size)
    edges = np.geomspace(frequencies[1], rate / 2, BANDS, endpoint=False)
    starts = np.unique(np.searchsorted(frequencies, edges))
    bands = np.log(np.add.reduceat(power, starts, axis=1) + 1e-12)
    return np.concatenate((bands.mean(axis=2).ravel(), signal.mean(axis=1)))
