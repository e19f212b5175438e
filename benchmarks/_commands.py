"""The commands that are disturbed, and what they leave behind as something to compare."""

import csv
import hashlib
import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks._processes import Ended, files, import_what_it_imports, partial_files, run
from tex_lightning.baselines.estimators import load_estimator
from tex_lightning.report.frontier_chart import PROCEDURE

LOGS = {"metrics", "tensorboard"}
TINY, FOLDS = ("debug=tiny", "data.folds=4"), "crossval.only=[0,1]"
SMALL = "data.synthetic.recordings=4"
QUIET = "logger.tensorboard=null"  # whose figures cost more than the rest
# Times differ from run to run, and what follows from them. `loops` are Lightning's counters, which
# know of an interrupted epoch.
TIMED = re.compile(
    r"seconds|_ms|^fit s$|^ratio$|^loops$|environment|on_frontier|chosen|command|procedure|"
    r"^overrides$"
)


@dataclass(frozen=True)
class Command:
    """A command line, and where it writes.

    Attributes:
        name: What it is called in the table.
        arguments: Of the command line.
        products: Folders that are not there before it.
    """

    name: str
    arguments: tuple[str, ...]
    products: tuple[Path, ...]


def prepare(root: Path) -> list[Command]:
    """Render surfaces, train what some of the commands start from; gives all commands.

    Args:
        root: An empty folder for all that the campaign writes.
    """
    surfaces, run_folder = root / "surfaces", root / "run"
    data = ("data=folder", f"data.root={surfaces}")
    cached = (*data, f"data.cache_dir={root / 'cache'}", *TINY)
    rendered = ("task=generate", "data.classes=3", f"generate.out={surfaces}", "debug=tiny", SMALL)
    _must(import_what_it_imports((*rendered, f"hydra.run.dir={root / 'generate'}"), root / "log"))
    *_, last = sorted(path.name for path in surfaces.iterdir() if path.is_dir())
    for name, held in (("base", ""), ("known", last)):
        trained = (
            "model=haptic",
            *cached,
            f"hydra.run.dir={root / name}",
            f"data.hold_out=[{held}]",
        )
        _must(run(trained, root / "log"))
    commands = {
        "fit": ("model=fusion_tcnn", "model.visual.width=0.1", *cached),
        "crossval": ("task=crossval", FOLDS, "model=haptic", QUIET, *cached),
        "sweep": ("-m", "model=mfcc_nb", "data.test_fold=0,2", QUIET, *cached),
        "frontier": ("task=frontier", "frontier.only=[bands,mfcc_nb]", FOLDS, *cached),
        "stability": ("task=stability", f"stability.systems=[{root / 'base'}]",
                      "stability.only=[white_noise,quieter]", QUIET, *cached),
        "export": ("task=export", f"checkpoint={root / 'base'}", "export.check=1", *cached),
        "enroll": ("task=enroll", f"checkpoint={root / 'known'}", f"enroll.only=[{last}]",
                   "data.test_fold=0", *cached),
        "store": ("model=mfcc_nb", QUIET, *data, f"data.cache_dir={root / 'fresh'}", *TINY),
    }  # fmt: skip
    return [
        Command(
            name,
            (*arguments, f"hydra.{'sweep' if name == 'sweep' else 'run'}.dir={run_folder}"),
            (run_folder, root / "fresh") if name == "store" else (run_folder,),
        )
        for name, arguments in commands.items()
    ]


def _must(ended: Ended) -> None:
    if ended.status:
        raise RuntimeError(f"A command failed undisturbed: {ended.said}")


def contents(command: Command, said: str = "", instead: str = "") -> dict[str, str]:
    """Names of all files that a command left, with a digest of those that hold its results.

    Weights and results count to the last bit, but for times and what follows from them; run
    folders are the same path in every run, so that paths count, too. Of figures and pages only the
    presence counts. Logs of an interrupted training lie beside those of its continuation.

    Args:
        command: That has run.
        said: Path that is another in this run.
        instead: What it is in the others.
    """
    texts = dict(text for folder in command.products for text in _texts(folder))
    if said:
        texts = {path.replace(said, instead): texts[path].replace(said, instead) for path in texts}
    return {path: hashlib.sha256(text.encode()).hexdigest() for path, text in texts.items()}


def _texts(folder: Path) -> Iterator[tuple[str, str]]:
    """Of each file its path and what of it counts."""
    for name in files(folder):
        path, text = folder / name, ""
        if LOGS & {*path.parts} or path.suffix == ".log":
            continue
        if path.suffix in READERS:
            text = json.dumps(READERS[path.suffix](path), sort_keys=True, default=_bytes)
        yield str(path), text


def _bytes(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, torch.Tensor):
        value = value.numpy()
    if isinstance(value, np.ndarray):
        return [str(value.dtype), value.shape, value.tobytes().hex()]
    raise TypeError(type(value))


def _checkpoint(path: Path) -> Any:  # noqa: ANN401
    content = torch.load(path, map_location="cpu", weights_only=True)
    if (estimator := content.get("baseline", {}).get("estimator")) is not None:
        content["baseline"]["estimator"] = vars(load_estimator(estimator))  # a file with addresses
    return _timeless(content)


def _json(path: Path) -> Any:  # noqa: ANN401
    return _timeless(json.loads(path.read_text(encoding="utf-8")))


def _table(path: Path) -> Any:  # noqa: ANN401
    with path.open(newline="", encoding="utf-8") as stream:
        rows = _timeless(list(csv.DictReader(stream)))
    return sorted(rows, key=str) if path.name == BY_LATENCY else rows


def _raw(path: Path) -> str:
    return path.read_bytes().hex()


def _timeless(value: Any) -> Any:  # noqa: ANN401
    if isinstance(value, dict):
        kept = {key: each for key, each in value.items() if not TIMED.search(str(key))}
        return {key: _timeless(each) for key, each in kept.items()}
    if isinstance(value, list):
        return [_timeless(each) for each in value if not _follows_times(each)]
    return value


def _follows_times(value: Any) -> bool:  # noqa: ANN401
    """Whether it is the row of the procedure that chooses by latency."""
    return isinstance(value, dict) and value.get("kind") == PROCEDURE


BY_LATENCY = "frontier.csv"  # the order of its lines

READERS = {
    ".ckpt": _checkpoint,
    ".json": _json,
    ".csv": _table,
    ".jsonl": _raw,
    ".onnx": _raw,
    ".npy": _raw,
}


@dataclass(frozen=True)
class Reference:
    """A command as it runs undisturbed.

    Attributes:
        command: The command.
        seconds: How long it takes.
        appearing: Names of its files, partial ones too, as far as they were seen.
        contents: Of its files.
    """

    command: Command
    seconds: float
    appearing: list[str]
    contents: dict[str, str]


def clear(command: Command) -> None:
    """Take away what a command has written."""
    for folder in command.products:
        shutil.rmtree(folder, ignore_errors=True)


def difference(ended: Ended, reference: Reference) -> str | None:
    """What is not as it is undisturbed, after a command has run through."""
    if ended.status:
        return f"it ended with status {ended.status} and said {ended.said[-2000:]}"
    command, expected = reference.command, reference.contents
    if left := partial_files(*command.products):
        return f"left {left}"
    found = contents(command)
    if absent := sorted({*expected} - {*found}):
        return f"lacks {absent}"
    if more := sorted({*found} - {*expected}):
        return f"has also {more}"
    differing = [name for name in expected if found[name] != expected[name]]
    return f"differs in {differing}" if differing else None
