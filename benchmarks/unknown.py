"""Whether recordings of materials never seen are told, by probability and by novelty.

``python -m benchmarks unknown``, or with other overrides than :data:`DEFAULT` ``python -m
benchmarks.unknown model=haptic data=folder data.root=DIR``. For each draw four classes
are held out of training, and two folds are trained and tested. The threshold is that of each
checkpoint; without a validation fold trained features have none, and the other fold's test sets it.
The default needs the recordings of ``shared/data/lmt16`` beside the checkout.
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
from tex_lightning.errors import UserError

REAL = Path(__file__).resolve().parents[2] / "shared" / "data" / "lmt16"
DEFAULT = ("experiment=few/haptic", "data=folder", f"data.root={REAL}")
DRAWS = 10
HELD_OUT = 4  # classes of each draw
RATE = 0.05  # of false rejections
CROSSVAL = ("task=crossval", "crossval.only=[0,5]", f"decision.unknown={RATE}")
AREAS = ("auroc", "novelty_auroc")
SHARES = ("false_rejections", "accepted_unknown")


def measure(overrides: Sequence[str] = DEFAULT) -> dict[str, Any]:
    """Means of the areas, pooled shares, and the same of every draw."""
    if overrides == DEFAULT and not REAL.is_dir():
        raise UserError(f"There are no recordings in {REAL}; put lmt16 there.")
    config = configured(*overrides)
    classes = read_recordings(config.data, config.model.modalities).classes
    draws = [_of_draw(overrides, draw(classes, number)) for number in range(DRAWS)]
    means = {f"{key}_mean": float(np.mean([each[key] for each in draws])) for key in AREAS}
    pooled = {
        key: sum(each[key]["count"] for each in draws) / sum(each[key]["of"] for each in draws)
        for key in SHARES
    }
    return {**means, **pooled, **{f"draw{n}": _told(each) for n, each in enumerate(draws)}}


def draw(classes: Sequence[str], number: int) -> list[str]:
    """The classes that are held out."""
    rng = np.random.default_rng(number)
    return sorted(rng.choice(classes, HELD_OUT, replace=False).tolist())


def _of_draw(overrides: Sequence[str], held_out: list[str]) -> dict[str, Any]:
    with TemporaryDirectory() as folder:
        hold_out = f"data.hold_out=[{','.join(held_out)}]"
        results = tl.train(*overrides, *CROSSVAL, hold_out, f"hydra.run.dir={folder}/run")
    *_, network = results["networks"].values()
    entry: dict[str, Any] = network["unknown"]
    return entry


def _told(entry: dict[str, Any]) -> dict[str, Any]:
    areas = {key: entry[key] for key in AREAS}
    shares = {key: entry[key]["share"] for key in SHARES}
    return {**areas, **shares, "held_out": " ".join(entry["classes"])}


if __name__ == "__main__":
    print(json.dumps(measure(tuple(sys.argv[1:]) or DEFAULT), indent=1))
