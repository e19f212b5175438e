"""Whether recordings of materials never seen are told, by probability and by novelty.

``python -m benchmarks unknown --only=lmt16``, or with overrides of your own ``python -m
benchmarks.unknown model=haptic data=folder data.root=DIR``. For each draw four classes are held out
of training, and two folds are trained and tested, others in each draw. The threshold is that of
each checkpoint; without a validation fold trained features have none, and the other fold's test
sets it. Recordings of ``shared/data`` beside the checkout are read where they are.

Two pairs of the synthetic surfaces feel alike and differ in their photos alone, so that a trace of
one is no unknown trace beside the other: they are trained on in each draw.
"""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import tex_lightning as tl
from benchmarks._classifiers import configured
from tex_lightning.data.readers import read_recordings

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
FEW = "experiment=few/haptic"
SETS = {
    "lmt16": (FEW, "data=folder", f"data.root={DATA}/lmt16"),
    "fingertip20": (FEW, "data=folder", f"data.root={DATA}/fingertip20"),
    "synthetic": (FEW, "data=synthetic", "data.synthetic.recordings=20"),
}
FEEL_ALIKE = ("S003", "S004", "S009", "S010")
DRAWS = {"lmt16": 10, "fingertip20": 5, "synthetic": 5}
HELD_OUT = 4  # classes of each draw
RATE = 0.05  # of false rejections
FOLDS = 10
AREAS = ("auroc", "novelty_auroc")
SHARES = ("false_rejections", "accepted_unknown")


def measure(only: str = "") -> dict[str, Any]:
    """Measure the data sets that ``only`` names, or all that are there."""
    names = only.split(",") if only else [name for name in SETS if _is_there(name)]
    return {name: measure_set(SETS[name], DRAWS[name]) for name in names}


def _is_there(name: str) -> bool:
    return "data=synthetic" in SETS[name] or (DATA / name).is_dir()


def measure_set(overrides: Sequence[str], draws: int) -> dict[str, Any]:
    """Return means of the areas, pooled counts, and the same of every draw."""
    config = configured(*overrides)
    classes = read_recordings(config.data, config.model.modalities).classes
    apart = [name for name in classes if not name.startswith(FEEL_ALIKE)]
    entries = [_of_draw(overrides, draw(apart, number), number) for number in range(draws)]
    means = {f"{key}_mean": float(np.mean([each[key] for each in entries])) for key in AREAS}
    counts = {key: _pooled([each[key] for each in entries]) for key in SHARES}
    return {**means, **counts, **{f"draw{n}": _told(each) for n, each in enumerate(entries)}}


def draw(classes: Sequence[str], number: int) -> list[str]:
    """The classes that are held out."""
    rng = np.random.default_rng(number)
    return sorted(rng.choice(classes, HELD_OUT, replace=False).tolist())


def folds_of(number: int) -> list[int]:
    """The folds that a draw tests: of ten draws each fold is tested twice."""
    return sorted((number + offset) % FOLDS for offset in (0, FOLDS // 2))


def _of_draw(overrides: Sequence[str], held_out: list[str], number: int) -> dict[str, Any]:
    with TemporaryDirectory() as folder:
        results = tl.train(
            *overrides, "task=crossval", f"crossval.only={folds_of(number)}",
            f"decision.unknown={RATE}", f"data.hold_out=[{','.join(held_out)}]",
            "verbose=0", f"hydra.run.dir={folder}/run",
        )  # fmt: skip
    *_, network = results["networks"].values()
    entry: dict[str, Any] = network["unknown"]
    return entry


def _pooled(shares: Sequence[dict[str, Any]]) -> dict[str, Any]:
    count, of = (sum(share[key] for share in shares) for key in ("count", "of"))
    return {"count": count, "of": of, "share": count / of}


def _told(entry: dict[str, Any]) -> dict[str, Any]:
    areas = {key: entry[key] for key in AREAS}
    shares = {key: entry[key]["share"] for key in SHARES}
    return {**areas, **shares, "held_out": " ".join(entry["classes"])}


if __name__ == "__main__":
    own = sys.argv[1:]
    print(json.dumps(measure_set(own, 10) if own else measure(), indent=1))
