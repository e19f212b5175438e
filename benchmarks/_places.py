"""Places that fail under a command: full disks, read-only folders, a cache that goes, others' runs.

Each function tries one kind of fault on a command and yields for each what went wrong, or None.
Disks are small file systems in memory, which only root can mount.
"""

import random
import re
import shutil
import subprocess
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from benchmarks._commands import Command, Reference, clear, contents, difference
from benchmarks._processes import Running, partial_files, run

SHARES = (0.02, 0.3, 0.6, 0.9)  # of the space that a command needs
FAR_ENOUGH = "1g"
TOGETHER = 8
SENTENCE = re.compile(r"^\W*([\d:]+\W+)?(Error|Job \d+): [^\n]+\.$", re.MULTILINE)

Fault = Callable[[Reference, Path, random.Random], Iterator[str | None]]


def can_mount(root: Path) -> bool:
    """Whether this process may mount file systems."""
    with suppress(OSError, subprocess.CalledProcessError), disk(root / "trial", "1m"):
        return True
    return False


@contextmanager
def disk(folder: Path, size: str | int) -> Iterator[None]:
    """A file system in memory in place of a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    _mount("-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder)
    try:
        yield
    finally:
        subprocess.run(["umount", "-l", folder], check=True)


def _mount(*arguments: str | Path) -> None:
    subprocess.run(["mount", *arguments], check=True, capture_output=True)


def full_disk(reference: Reference, root: Path, rng: random.Random) -> Iterator[str | None]:
    """The disk is full after a share of what is to be written; then there is space."""
    yield from _filled(reference, root, reference.command.products[-1], SHARES)


def full_cache(reference: Reference, root: Path, rng: random.Random) -> Iterator[str | None]:
    """The same of the disk of an empty cache."""
    yield from _filled(reference, root, _cache(reference.command), (rng.choice(SHARES),))


def _filled(
    reference: Reference, root: Path, place: Path, shares: Iterable[float]
) -> Iterator[str | None]:
    command = reference.command
    clear(command)
    shutil.rmtree(place, ignore_errors=True)
    run(command.arguments, root / "log")
    needed = sum(path.stat().st_size for path in place.rglob("*") if path.is_file())
    for share in shares:
        clear(command)
        with disk(place, max(4096, int(share * needed))):
            wrong = _refused(command, root)
            _mount("-o", f"remount,size={FAR_ENOUGH}", place)
            wrong = wrong or difference(run(command.arguments, root / "log"), reference)
            yield wrong and f"{share:.0%} of {needed} bytes: {wrong}"


def full_disk_under_finished_work(
    reference: Reference, root: Path, rng: random.Random
) -> Iterator[str | None]:
    """The disk is full under a finished run; the same command changes nothing of it."""
    command, place = reference.command, reference.command.products[-1]
    clear(command)
    with disk(place, FAR_ENOUGH):
        run(command.arguments, root / "log")
        filler = place / "filler"
        with suppress(OSError), filler.open("wb") as stream:
            while True:
                stream.write(bytes(4096))
                stream.flush()
        ended = run(command.arguments, root / "log")
        filler.unlink()
        wrong = None if ended.status in {0, 2} else f"status {ended.status}: {ended.said[-2000:]}"
        if "Traceback" in ended.said:
            wrong = ended.said[-2000:]
        wrong = wrong or _differing(reference)
        yield wrong or difference(run(command.arguments, root / "log"), reference)


def _differing(reference: Reference) -> str | None:
    found, expected = contents(reference.command), reference.contents
    differing = [name for name in expected if found.get(name) != expected[name]]
    return f"damaged {differing}" if differing else None


def read_only(reference: Reference, root: Path, rng: random.Random) -> Iterator[str | None]:
    """The run folder, then the cache, cannot be written to; then they can."""
    command = reference.command
    for place in (command.products[0], _cache(command)):
        clear(command)
        with disk(place, FAR_ENOUGH):
            _mount("-o", "remount,ro", place)
            wrong = _refused(command, root)
            _mount("-o", "remount,rw", place)
            wrong = wrong or difference(run(command.arguments, root / "log"), reference)
            yield wrong and f"{place.name}: {wrong}"


def _refused(command: Command, root: Path) -> str | None:
    """Run a command that cannot be done; what is wrong with how it says so."""
    ended = run(command.arguments, root / "log")
    said = ended.said[-3000:]
    if "Traceback" in said:
        return f"it ended with status {ended.status} and said {said}"
    failed = 1 if command.arguments[0] == "-m" else 2  # a sweep goes on, and says how many failed
    if ended.status not in {2, failed} or not SENTENCE.search(said):
        return f"it ended with status {ended.status} and said {said}"
    return None


def _cache(command: Command) -> Path:
    (given,) = [each for each in command.arguments if each.startswith("data.cache_dir=")]
    return Path(given.partition("=")[2])


def vanishing_cache(reference: Reference, root: Path, rng: random.Random) -> Iterator[str | None]:
    """The cache is deleted once, at any moment."""
    yield _robbed(reference, root, lambda: rng.uniform(0.1, 1) * reference.seconds, 1)


def deleted_cache(reference: Reference, root: Path, rng: random.Random) -> Iterator[str | None]:
    """The cache is deleted again and again."""
    yield _robbed(reference, root, lambda: rng.uniform(0, 0.1), 1_000_000)


def _robbed(reference: Reference, root: Path, wait: Callable[[], float], times: int) -> str | None:
    command, cache = reference.command, _cache(reference.command)
    clear(command)
    running = Running(command.arguments, root / "log")
    for _ in range(times):
        until = time.monotonic() + wait()
        if not running.wait(lambda until=until: time.monotonic() > until):  # type: ignore[misc]
            break
        shutil.rmtree(cache, ignore_errors=True)
    ended = running.end()
    if ended.status == 2 and "Traceback" not in ended.said:  # a sentence
        ended = run(command.arguments, root / "log")
    elif cache in command.products:  # what was deleted last is not there
        ended = run(command.arguments, root / "log") if ended.status == 0 else ended
    return difference(ended, reference)


def two_at_once(reference: Reference, root: Path, rng: random.Random) -> Iterator[str | None]:
    """The same command twice at a time: one does the work, the other refuses or finds it done."""
    command = reference.command
    clear(command)
    first = Running(command.arguments, root / "log")
    until = time.monotonic() + rng.uniform(0, 0.8) * reference.seconds
    first.wait(lambda: time.monotonic() > until)
    second = Running(command.arguments, root / "second")
    both = [first.end(), second.end()]
    bad = [each for each in both if "Traceback" in each.said or each.status not in {0, 2}]
    if bad or all(each.status for each in both):
        yield "; ".join(f"status {each.status}: {each.said[-2000:]}" for each in bad or both)
    else:
        done = next(each for each in both if each.status == 0)
        yield difference(done, reference)


def many_at_once(reference: Reference, root: Path, rng: random.Random) -> Iterator[str | None]:
    """Eight processes fill one store, each for a run folder of its own."""
    command = reference.command
    run_folder, cache = command.products[0], _cache(command)
    clear(command)
    shutil.rmtree(cache, ignore_errors=True)
    *arguments, place = command.arguments
    homes = [root / f"many{number}" for number in range(TOGETHER)]
    running = [
        Running((*arguments, place.replace(str(run_folder), str(home))), home.with_suffix(".log"))
        for home in homes
    ]
    ended = [each.end() for each in running]
    for home, each in zip(homes, ended, strict=True):
        if each.status:
            yield f"status {each.status}: {each.said[-2000:]}"
        else:
            own = contents(Command("", (), (home,)), str(home), str(run_folder))
            yield None if own == _below(run_folder, reference) else f"{home.name} differs"
        shutil.rmtree(home)
    left, expected = partial_files(cache), _below(cache, reference)
    same = not expected or contents(Command("", (), (cache,))) == expected
    yield f"left {left}" if left else None if same else "it differs"


def _below(folder: Path, reference: Reference) -> dict[str, str]:
    items = reference.contents.items()
    return {name: each for name, each in items if Path(name).is_relative_to(folder)}


FAULTS: dict[str, Fault] = {
    "full disk": full_disk,
    "full cache": full_cache,
    "full disk under finished work": full_disk_under_finished_work,
    "read-only folder": read_only,
    "cache deleted": vanishing_cache,
    "cache deleted again and again": deleted_cache,
    "twice at once": two_at_once,
    "eight at once": many_at_once,
}
MOUNTED = (full_disk, full_cache, full_disk_under_finished_work, read_only)
