"""What each classifier loses where recordings have another shape, but are of the same materials.

``python -m benchmarks shapes --data=DIR --sets=fingertip20 --models=few --only=test_hum --out=DIR``

``shapes.yaml`` (or ``--table=FILE``) says what is run on the folder ``--data``, or that in
``TEX_LIGHTNING_REAL_DATA``; a shape is one line there. ``--sets``, ``--models`` and ``--only``, of
shapes, take names, or how they begin. Each cell is a training and a test by the package's own way,
from a manifest, so that what a check refuses is refused; it leaves a JSON file in ``--out`` and is
not run again there. The table has all cells that are there; ``--before=DIR`` puts those of another
version beside them.
"""

import json
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from hashlib import sha256
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import cv2
import numpy as np

import tex_lightning as tl
from benchmarks._changes import SPARE, TEST, TRAIN, Item, Items, apply
from benchmarks._paired import COLUMNS, UNCHANGED, Cell, compare, shown, to_table
from benchmarks._run import RESULTS
from benchmarks.accuracy import SPLIT, read_rows, read_signals, read_table
from tex_lightning.core.console import console
from tex_lightning.core.files import write_rows, write_text
from tex_lightning.core.run_folder import predictions_of
from tex_lightning.data.decode import PhotoDecoder
from tex_lightning.data.folds import is_tested
from tex_lightning.data.manifest import write_manifest
from tex_lightning.data.recordings import Recording, Recordings
from tex_lightning.errors import UserError, listed
from tex_lightning.evaluation.outcomes import read_outcomes
from tex_lightning_runtime.files import natural_key

BASE = "base"
KINDS = {"any": "", "axes": "haptic"}  # what a section of shapes changes, if not its name
Node = dict[str, Any]
Rows = Sequence[tl.Recording]


class Shape(NamedTuple):
    """Changes by part, what they are compared with, and the modality that is changed."""

    changes: Node
    base: str
    kind: str


def measure(
    data: str = "", sets: str = "", models: str = "", only: str = "", out: str = "",
    table: str = "", before: str = "",
) -> Node:  # fmt: skip
    """Run the cells that are asked for; return what each has lost, in words."""
    settings = read_table(data, table or str(Path(__file__).with_suffix(".yaml")))
    target = Path(out) if out else RESULTS / "shapes"
    cells = cells_of(settings, sets, models, only)
    measured = {cell: run(settings, cell, target) for cell in cells}
    lines = compare({**finished(settings, target), **measured})
    earlier = compare(finished(settings, Path(before))) if before else []
    write_rows(target / "shapes.csv", COLUMNS, [[line[name] for name in COLUMNS] for line in lines])
    write_text(target / "shapes.md", to_table(lines, earlier))
    asked = [line for line in lines if Cell(*(line[name] for name in Cell._fields)) in measured]
    figures = {f"{x['set']}.{x['shape']}.{x['model']}": shown(x) for x in asked}
    return {**figures, "in": str(target)}


def cells_of(settings: Node, sets: str = "", models: str = "", only: str = "") -> list[Cell]:
    """Return the cells that are asked for, each after the one that it is compared with."""
    shapes = list(dict.fromkeys(name for part in settings["shapes"].values() for name in part))
    wanted, systems = chosen(shapes, only), chosen([*settings["models"]], models)
    cells = []
    for name in chosen([*settings["data"]], sets):
        own = shapes_of(settings, name)
        ways = [[*bases(own, shape)][::-1] for shape in wanted if shape in own]
        ordered = dict.fromkeys(shape for way in ways for shape in (UNCHANGED, *way))
        used = [model for model in systems if model in settings["data"][name]["models"]]
        cells += [Cell(name, shape, model, own[shape].base) for model in used for shape in ordered]
    return cells


def finished(settings: Node, target: Path) -> dict[Cell, Node]:
    """Return the results of all cells that were finished in a folder."""
    found = {cell: kept(settings, cell, target) for cell in cells_of(settings)}
    return {cell: result for cell, result in found.items() if result is not None}


def bases(shapes: Mapping[str, Shape], shape: str) -> Iterator[str]:
    """Yield a shape, what it is compared with, and so on."""
    yield shape
    if shape != UNCHANGED:
        yield from bases(shapes, shapes[shape].base)


def chosen(names: Sequence[str], words: str) -> list[str]:
    """Return the names that are given with commas between, or by how they begin; by default all."""
    given = words.split(",") if words else list(names)
    for word in given:
        if not any(name.startswith(word) for name in names):
            raise UserError(f"{word} begins no name; choose from {listed(sorted(names))}.")
    begun = tuple({*given} - {*names})
    return [name for name in names if name in given or (begun and name.startswith(begun))]


def shapes_of(settings: Node, name: str) -> dict[str, Shape]:
    """Return the shapes that a data set can have, by name."""
    entry, shapes = settings["data"][name], {}
    for kind in ("any", *entry["divide"], *entry.get("more", ())):
        for shape, line in settings["shapes"].get(kind, {}).items():
            changes = {part: steps for part, steps in line.items() if part != BASE}
            shapes[shape] = Shape(changes, line.get(BASE, UNCHANGED), KINDS.get(kind, kind))
    return shapes


def file_of(settings: Node, cell: Cell, target: Path) -> Path:
    """Return the file of a cell's result, whose name changes with its settings."""
    entry, model = settings["data"][cell.set], settings["models"][cell.model]
    read = {key: value for key, value in entry.items() if key not in ("reads", "models", "more")}
    shape = shapes_of(settings, cell.set)[cell.shape]
    told = repr((read, model, shape.changes, settings["common"]))
    return target / "cells" / f"{'-'.join(cell[:3])}-{sha256(told.encode()).hexdigest()[:8]}.json"


def kept(settings: Node, cell: Cell, target: Path) -> Node | None:
    """Return the result of a cell that was finished before."""
    file = file_of(settings, cell, target)
    return json.loads(file.read_text(encoding="utf-8")) if file.is_file() else None


def run(settings: Node, cell: Cell, target: Path) -> Node:
    """Return the result of a cell: from its file, else measured; what fails is run again."""
    if (result := kept(settings, cell, target)) is not None:
        return result
    shape = shapes_of(settings, cell.set)[cell.shape]
    try:
        items = apply(shape.changes, load(settings, cell.set), cell.shape, shape.kind)
        result = classify(*way(settings, cell, target), items)
    except UserError as error:
        result = {"said": f"refused: {str(error).splitlines()[0]}"}
    except Exception as error:  # the other cells are run, whatever it is
        result = {"said": f"failed: {error!r}"}
    if not result["said"].startswith("failed"):
        write_text(file_of(settings, cell, target), json.dumps(result) + "\n")
    hits = [label == predicted for label, predicted in result.get("outcomes", {}).values()]
    print(*cell[:3], sum(hits), len(hits), result["said"][:200], flush=True)
    return result


def way(settings: Node, cell: Cell, target: Path) -> tuple[list[str], Path | None]:
    """Return the overrides by which a cell is run, and the folder in which its run is kept.

    A model whose checkpoint serves all shapes of the tested recordings is trained once.
    """
    model, changes = (
        settings["models"][cell.model],
        shapes_of(settings, cell.set)[cell.shape].changes,
    )
    overrides = [*settings["common"], *model["overrides"]]
    if not model.get("once"):
        return overrides, None
    home = file_of(settings, cell._replace(shape=UNCHANGED), target / "runs").with_suffix("")
    if cell.shape == UNCHANGED:
        return overrides, home
    if {*changes} <= {TEST} and (home / "results.json").is_file():
        return [*settings["common"], "task=evaluate", f"checkpoint={home}"], None
    return overrides, None


def classify(overrides: Sequence[str], home: Path | None, items: Items) -> Node:
    """Train and test by the package, from files and a manifest.

    Args:
        overrides: Task and model.
        home: Folder in which the run is kept; None keeps nothing.
        items: Training and test recordings.

    Returns:
        By the key of each tested recording its class and the predicted one, which is empty where
        the package left it out; seconds of the fit.

    Raises:
        UserError: If the package refuses, without the name of the folder.
    """
    with TemporaryDirectory() as name, console.capture():
        folder = Path(name)
        write_manifest(Recordings(tuple(write(item, folder) for item in items)), folder / "all.csv")
        data = (f"data.manifest={folder}/all.csv", f"data.cache_dir={folder}/cache")
        tested = f"data.test_where={{{SPLIT}: {TEST}}}"
        keep = f"hydra.run.dir={home or folder / 'run'}"
        try:
            results = tl.train(*overrides, "data=manifest", *data, tested, keep)
        except UserError as error:
            raise UserError(str(error).replace(f"{folder}/", "")) from error
        *_, (network, entry) = results["networks"].items()
        outcomes = read_outcomes(predictions_of(results.folder, network))
    kinds = sorted(outcomes[0].files)
    missing = {x.key: (x.label, "") for x in items if x.part == TEST and [x.modality] == kinds}
    given = {
        "|".join(Path(x.files[kind]).stem for kind in kinds): (x.label, x.predicted)
        for x in outcomes
    }
    return {"outcomes": {**missing, **given}, "fit_seconds": entry["fit_seconds"], "said": ""}


def write(item: Item, folder: Path) -> Recording:
    """Write the file of a recording; return its row of the table."""
    path = folder / f"{item.key}.{'npy' if item.rate else 'png'}"
    if item.rate:
        np.save(path, item.array.astype(np.float32))
    else:
        pixels = item.array[..., ::-1] if item.array.ndim == 3 else item.array
        cv2.imwrite(str(path), pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    rate, conditions = item.rate or None, ((SPLIT, item.part),)
    return Recording(item.label, item.modality, path, item.group, rate, conditions)


def load(settings: Node, name: str) -> Sequence[Item]:
    """Read and divide all recordings of a data set."""
    return _load(json.dumps(settings["data"][name]))


@lru_cache(1)
def _load(text: str) -> tuple[Item, ...]:
    entry: Node = json.loads(text)
    items: Items = []
    for modality, division in entry["divide"].items():
        rows = read_rows({**entry, "modality": modality})
        photos = modality == "image"
        read = read_photos(rows) if photos else read_signals(rows, entry.get("keys", ()))
        items += [
            Item(f"{modality}{n:04d}", row.label, row.group, part, modality, *signal)
            for n, (row, part, signal) in enumerate(
                zip(rows, divide(rows, division), read, strict=True)
            )
        ]
    return tuple(items)


def read_photos(rows: Rows) -> list[tuple[Any, float]]:
    """Return pixels (height, width, 3) of every photo, and 0 for a rate that it does not have."""
    return [(PhotoDecoder(half_scale=False).decode(row.path)[0], 0.0) for row in rows]


def divide(rows: Rows, division: Node) -> list[str]:
    """Return the part of each row; those that are neither trained on nor tested are spare."""
    order = sorted(rows, key=lambda row: natural_key(str(row.group)))
    groups: dict[str, dict[str, int]] = defaultdict(dict)
    for row in order:
        groups[row.label].setdefault(str(row.group), len(groups[row.label]))
    parts, seen = [], Counter[str]()
    for row in rows:
        if "train" in division:
            is_first = groups[row.label][str(row.group)] < division["train"]
            is_later = not is_first
        else:
            is_first, is_later = (
                bool(is_tested(row, division[f"{x}_where"])) for x in (TRAIN, TEST)
            )
        tests = is_later and seen[row.label] % division["every"] == 0
        seen[row.label] += is_later
        parts.append(TRAIN if is_first else TEST if tests else SPARE)
    return parts
