"""Classes added to a trained network against a network that is trained anew with everything.

Of the 16 classes of lmt16 (folder ``shared/data`` beside the checkout) some are held out of a
training and then added from their first 1, 3 and 5 recordings. Every draw of the held-out classes
tests another fold, of all 16 classes. Trained anew is the same network on all recordings of the
old classes and as few of the new ones. Runs are kept below ``outputs/benchmarks/enrolment`` and
not done twice.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import tex_lightning as tl
from benchmarks._run import RESULTS
from tex_lightning.data.folds import next_of_each
from tex_lightning.data.recordings import Recordings, write_manifest
from tex_lightning.errors import UserError
from tex_lightning.evaluation.outcomes import read_outcomes
from tex_lightning.report.figures import LearningPoint, learning_figure, save_figure

REAL = (Path(__file__).resolve().parents[2] / "shared" / "data" / "lmt16").resolve()
RUNS = RESULTS / "enrolment"
FOLDS = 10
DRAWS = range(4)  # of held-out classes; the number is that of the tested fold, too
COUNTS = (1, 3, 5)  # recordings of a new class
ADDED = {"few/haptic": (2, 4, 8)}
ANEW = {"few/haptic": COUNTS}  # trained with everything


class Votes(NamedTuple):
    """Correct votes of a tested fold, of old and of new classes, and how many there were."""

    old: int
    olds: int
    new: int
    news: int

    def __add__(self, other: "Votes") -> "Votes":  # type: ignore[override]
        return Votes(*(one + two for one, two in zip(self, other, strict=True)))

    def figures(self) -> dict[str, float]:
        """Shares, and all of them as counts."""
        shares = {"old": self.old / self.olds, "all": (self.old + self.new) / sum(self[1::2])}
        return shares | ({"new": self.new / self.news} if self.news else {})


def measure() -> dict[str, Any]:
    """Train, add, train anew; draw what came out."""
    if not REAL.is_dir():
        raise UserError("There is no shared/data/lmt16 beside the checkout; put it there.")
    rows = tl.read_folder(REAL)
    figures: dict[str, Any] = {}
    for experiment, sizes in ADDED.items():
        curves: dict[str, list[LearningPoint]] = {}
        for size in sizes:
            name = f"{experiment.replace('/', '_')}_{size}_added"
            figures[name] = _measured(experiment, size, rows, curves)
        save_figure(
            learning_figure({name: points for name, points in curves.items() if points}),
            RESULTS / f"enrolment_{experiment.replace('/', '_')}",
            ["png"],
        )
    return figures


def _measured(
    experiment: str, size: int, rows: Recordings, curves: dict[str, list[LearningPoint]]
) -> dict[str, Any]:
    found: dict[str, Any] = {}
    before, seconds = Votes(0, 0, 0, 0), []
    after = {how: {count: Votes(0, 0, 0, 0) for count in COUNTS} for how in ("added", "anew")}
    for draw in DRAWS:
        new = _drawn(rows.classes, draw, size)
        folder = RUNS / f"{experiment.replace('/', '_')}-{size}-{draw}"
        base = _train(folder / "base", draw, experiment, rows, f"data.hold_out=[{','.join(new)}]")
        before += _votes(base, new)
        for count in COUNTS:
            added = _run(
                folder / f"added{count}", "task=enroll", f"checkpoint={base.folder}",
                "data=folder", f"data.root={REAL}", f"data.test_fold={draw}",
                f"enroll.only=[{','.join(new)}]", f"data.per_class={count}",
            )  # fmt: skip
            after["added"][count] += _votes(added, new)
            seconds.append(added["networks"]["haptic"]["enroll_seconds"])
            if count in ANEW[experiment]:
                kept = _with_few(rows, new, draw, count)
                anew = _train(folder / f"anew{count}", draw, experiment, kept)
                after["anew"][count] += _votes(anew, new)
    found["before"] = before.figures()
    found["enroll_seconds"] = float(np.median(seconds))
    for how, by_count in after.items():
        points = {count: votes for count, votes in by_count.items() if votes.olds}
        found[how] = {str(count): votes.figures() for count, votes in points.items()}
        title = f"{size} classes {'added' if how == 'added' else 'trained anew'}"
        curves[title] = [
            LearningPoint(count, votes.old + votes.new, votes.olds + votes.news)
            for count, votes in points.items()
        ]
    return found


def _drawn(classes: Sequence[str], draw: int, size: int) -> list[str]:
    return sorted(np.random.default_rng(draw).permutation(classes)[:size].tolist())


def _run(folder: Path, *overrides: str) -> tl.Results:
    """The results of a run that is done, or is done now."""
    done = folder / "results.json"
    if done.is_file():
        return tl.Results(json.loads(done.read_text(encoding="utf-8")), folder)
    return tl.train(*overrides, f"hydra.run.dir={folder}")


def _train(folder: Path, draw: int, experiment: str, rows: Recordings, *given: str) -> tl.Results:
    """A finished run of the network on these recordings; the fold before the tested validates."""
    folder.mkdir(parents=True, exist_ok=True)
    manifest = folder.parent / f"{folder.name}.csv"
    write_manifest(rows, manifest)
    return _run(
        folder, f"experiment={experiment}", "data=manifest", f"data.manifest={manifest}", *given,
        f"data.test_fold={draw}", f"data.val_fold={(draw - 1) % FOLDS}",
    )  # fmt: skip


def _with_few(rows: Recordings, new: Sequence[str], fold: int, count: int) -> Recordings:
    """All recordings, but of the new classes only so many to train on, and those to test on."""
    others = [row for row in rows.in_classes(new) if row.fold != fold]
    kept = next_of_each(others, count, fold, FOLDS)
    return rows.without(set(others).difference(kept))


def _votes(results: tl.Results, new: Sequence[str]) -> Votes:
    outcomes = read_outcomes(results.folder / "predictions" / "haptic.csv")
    old = [each.label == each.predicted for each in outcomes if each.label not in new]
    added = [each.label == each.predicted for each in outcomes if each.label in new]
    return Votes(sum(old), len(old), sum(added), len(added))
