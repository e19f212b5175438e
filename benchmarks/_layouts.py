"""Folders in the layouts of the data sets that are read, and ways to damage them."""

from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from shutil import rmtree

import numpy as np

from benchmarks._attempts import Attempt, attempt
from benchmarks._classifiers import configured
from tex_lightning.data.readers import read_recordings
from tex_lightning.data.readers.kth_tips2b import NUMBERS

Names = list[str]
NASTY = ("é中.wav", "-rf.wav", "x" * 200 + ".jpg", " .png", "..wav", "\x1b[31m.csv",
         "a;b.xml", "Thumbs.db", ".DS_Store", "\udce9.wav", "rates.csv", "a.json")  # fmt: skip


def _folder() -> Names:
    senses = (("haptic", "wav"), ("image", "png"), ("sound", "flac"), ("force", "npy"))
    return [
        f"{label}/{sense}/{number}.{suffix}"
        for label in ("oak", "felt")
        for sense, suffix in senses
        for number in range(3)
    ]


def _tum() -> Names:
    labels = ("G1Mesh", "G2Brick")
    traces = [f"Training/Accel/{label}_query{n}.txt" for label in labels for n in range(10)]
    return [*traces, *(f"Training/Photos/IMG_{n}.JPG" for n in range(20))]


def _lmt108() -> Names:
    names = []
    for label, n in product(("G1Mesh", "G2Brick"), range(1, 11)):
        moved = f"AccelScansComponents/Movement/Training/{label}_Movement"
        names += [f"{moved}_{axis}_train{n}.txt" for axis in "XYZ"]
        names.append(f"ImageScans/NoFlash/Training/{label}_Image_{n}_train{n}.jpg")
        names.append(f"SoundScans/Movement/Training/{label}_Sound_Movement_train{n}.wav")
    return names


def _kylberg() -> Names:
    return [
        f"{label}/{label}-{'abcd'[patch // 40]}-p{patch % 40 + 1:03d}.png"
        for label in ("blanket1", "canvas1")
        for patch in range(160)
    ]


def _kth() -> Names:
    parts = product(("cork", "wool"), "abcd", range(2, 11), range(1, 13))
    return [
        f"{label}/sample_{sample}/{NUMBERS[label]}{sample}-scale_{scale}_im_{image}_col.png"
        for label, sample, scale, image in parts
    ]


def _hatt() -> Names:
    return [f"RecordedData/Carpet {n}_Recording{m}.xml" for n in (1, 2) for m in (1, 2)]


def _cluster() -> Names:
    strokes = product((0, 12), (0, 135), (20, 60), (500, 1000), (0, 1))
    traces = [
        f"sensor_data/accel/{surface}/{surface}_{'_'.join(map(str, stroke))}.csv"
        for surface, *stroke in strokes
    ]
    return [*traces, *(f"images/images_scan_area/img{n}.jpg" for n in (0, 12))]


LAYOUTS: dict[str, tuple[Callable[[], Names], tuple[str, ...]]] = {
    "data=folder": (_folder, ()),
    "data=tum": (_tum, ()),
    "data=lmt108": (_lmt108, ()),
    "data=kylberg": (_kylberg, ()),
    "data=kth_tips2b": (_kth, ()),
    "data=hatt": (_hatt, ()),
    "data=cluster": (_cluster, ("data.folds=2",)),
}
CONTENT = {"cluster": "time,X,Y,Z\n"}  # of a file, where a reader looks into it


def damaged_trees(name: str, count: int, folder: Path) -> Iterator[tuple[str, Attempt]]:
    """Each damage of a layout by name and what came of it."""
    names, more = LAYOUTS[name]
    root, kind = folder / "root", name.partition("=")[2]
    data = configured("model=haptic", name, f"data.root={root}", *more).data

    def read() -> list[np.ndarray]:
        rows = read_recordings(data)
        return [np.array([row.fold for row in rows], np.float64)]

    rng = np.random.default_rng(len(name))
    for place in range(-1, count):
        rmtree(root, ignore_errors=True)
        for each in names():
            (root / each).parent.mkdir(parents=True, exist_ok=True)
            (root / each).write_text(CONTENT.get(kind, ""))
        way = DAMAGES[place % len(DAMAGES)]
        if place >= 0:
            way(root, rng)
        found = attempt(read, str(folder), "The data has only")
        if place >= 0:
            yield way.__name__, found
        elif found.outcome != "accepted":
            raise RuntimeError(f"{name} is refused whole: {found.why}")


def _some(root: Path, rng: np.random.Generator, folders: bool = False) -> Path:
    every = sorted(path for path in root.rglob("*") if path.is_dir() == folders)
    return every[int(rng.integers(len(every)))]


def remove(root: Path, rng: np.random.Generator) -> None:
    _some(root, rng).unlink()


def remove_folder(root: Path, rng: np.random.Generator) -> None:
    rmtree(_some(root, rng, folders=True))


def rename(root: Path, rng: np.random.Generator) -> None:
    """One character of a name is another."""
    path = _some(root, rng, folders=bool(rng.random() < 0.3))
    place = int(rng.integers(len(path.name)))
    other = "aZ0_-. é9"[int(rng.integers(9))]
    target = path.with_name(path.name[:place] + other + path.name[place + 1 :])
    if not target.exists():
        path.rename(target)


def add_nasty(root: Path, rng: np.random.Generator) -> None:
    """A file of an odd name beside the others."""
    name = NASTY[int(rng.integers(len(NASTY)))]
    (_some(root, rng).parent / name).write_bytes(rng.bytes(20))


def double(root: Path, rng: np.random.Generator) -> None:
    """A file once more, under another suffix, in capitals or in a folder below."""
    path = _some(root, rng)
    inner = path.parent / "inner"
    inner.mkdir(exist_ok=True)
    targets = (path.with_suffix(".csv"), path.with_name(path.name.upper()), inner / path.name)
    target = targets[int(rng.integers(3))]
    if not target.exists():
        target.write_bytes(path.read_bytes())


def make_folder(root: Path, rng: np.random.Generator) -> None:
    """A folder where a file was."""
    path = _some(root, rng)
    path.unlink()
    path.mkdir()


def make_loop(root: Path, rng: np.random.Generator) -> None:
    """A link to itself, to the folder above or to nothing where a file was."""
    path = _some(root, rng)
    path.unlink()
    path.symlink_to((path, path.parent, path.parent.parent, path / "x")[int(rng.integers(4))])


def put_noise(root: Path, rng: np.random.Generator) -> None:
    _some(root, rng).write_bytes(rng.bytes(int(rng.integers(1, 3000))))


def add_statement(root: Path, rng: np.random.Generator) -> None:
    """A ``rates.csv`` that is none."""
    path = _some(root, rng).parent / "rates.csv"
    path.write_bytes([b"", b"\0", b"path,rate\na\0b,1\n", b"path,rate\n,\n", rng.bytes(50)]
                     [int(rng.integers(5))])  # fmt: skip


DAMAGES = (remove, remove_folder, rename, rename, add_nasty, double, make_folder, make_loop,
           put_noise, add_statement)  # fmt: skip
