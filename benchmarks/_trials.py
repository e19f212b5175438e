"""The damaged files of one format given to its reader, in a process of their own."""

import os
import tempfile
from collections.abc import Iterator
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path

import torch

from benchmarks._attempts import Attempt, Tally, attempt, limit_memory
from benchmarks._cards import CARDS, damaged_cards
from benchmarks._layouts import LAYOUTS, damaged_trees
from benchmarks._mutate import mutated
from benchmarks._runtime_files import RUNTIME
from benchmarks._seeds import FORMATS

FILES = {**FORMATS, **RUNTIME}
NAMES = (*FILES, *CARDS, *LAYOUTS)
COUNT = 48  # files of each format


def in_process(name: str, count: int) -> Tally:
    """Try a format in a process of its own; its end is a wrong of the last file."""
    context = get_context("forkserver")
    context.set_forkserver_preload([__name__])
    mine, theirs = context.Pipe(duplex=False)
    process = context.Process(target=_send, args=(theirs, name, count))
    process.start()
    theirs.close()
    tally = Tally()
    try:
        while (found := mine.recv()) is not None:
            tally.add(*found)
    except EOFError:
        process.join()
        tally.tried += 1
        tally.wrong.append(f"number {tally.tried} ended the process ({process.exitcode})")
    process.join()
    return tally


def _send(pipe: Connection, name: str, count: int) -> None:
    torch.set_num_threads(1)
    os.environ["OMP_NUM_THREADS"] = "1"
    with tempfile.TemporaryDirectory() as folder:
        for found in attempts(name, count, Path(folder).resolve()):
            pipe.send(found)
    pipe.send(None)


def attempts(name: str, count: int, folder: Path) -> Iterator[tuple[str, Attempt]]:
    """Each damage by name and what came of it."""
    if name in LAYOUTS:
        yield from damaged_trees(name, count, folder)
        return
    if name in CARDS:
        limit_memory()
        yield from damaged_cards(name, count, folder)
        return
    kind = FILES[name]
    path = folder / kind.name
    path.parent.mkdir(exist_ok=True)
    kind.write(path)
    seed = path.read_bytes()
    whole = attempt(lambda: kind.read(path), str(folder), *kind.says)
    if whole.outcome != "accepted":
        raise RuntimeError(f"{name} is refused whole: {whole.why}")
    limit_memory()
    number = [*FILES].index(name)
    total = round(count * kind.weight)
    for way, content in mutated(seed, total, text=kind.text, number=number):
        path.write_bytes(content)
        yield way, attempt(lambda: kind.read(path), str(folder), *kind.says)
