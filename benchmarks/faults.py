"""Commands that are ended at any moment go on to the same results: killed, terminated, Ctrl-C.

``python -m benchmarks faults --rounds=5 --only=fit,export --kinds="SIGKILL,full disk"``

Each command runs undisturbed twice, which must agree. Then it is ended ``rounds`` times by each of
SIGKILL, SIGTERM and SIGINT and run again as it was. Half the moments are uniform over the time that
it takes undisturbed, half are up to 30 ms after one of its files appears (a checkpoint that is
being written, ``results.json``, a decoded recording). A fault is survived if the command

* ended by the signal itself, or with status 130 and one line; or had just come to its end,
* then runs through, and every file is there that is there undisturbed, and no other: weights,
  results, tables and exported files equal to the last bit, but for times and what follows from
  them. No half-written file is left in the run folder or in the cache.

What else goes wrong is tried, too (``_places.py``): full disks and read-only folders, which only
root can make; a cache that is deleted once or again and again; the same command twice at once, and
eight processes that fill one store. There a command may also end with one sentence and status 2.

A process is forked from one that has imported the package, leads its own session and runs the
package's main entry, so that what is disturbed is the command and not the import of PyTorch.
"""

import random
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks._commands import Command, Reference, clear, contents, difference, prepare
from benchmarks._places import FAULTS, MOUNTED, can_mount
from benchmarks._processes import Ended, Running, files, import_what_it_imports, run
from tex_lightning.errors import UserError

SIGNALS = ("SIGKILL", "SIGTERM", "SIGINT")
INTERRUPTED = 130
AFTER_S = 0.03  # of a file's appearance
MAX_TRIES = 20  # until a moment comes before the end of the command


@dataclass
class Count:
    """What became of faults of one kind; ``lost`` says why some were not survived."""

    tried: int = 0
    lost: list[str] = field(default_factory=list)

    def add(self, wrong: str | None) -> None:
        """Count one fault."""
        self.tried += 1
        if wrong:
            self.lost.append(wrong)

    def __str__(self) -> str:
        said = f"{self.tried} tried, {self.tried - len(self.lost)} survived, {len(self.lost)} lost"
        return "\n".join([said, *self.lost])


def measure(rounds: str = "5", only: str = "", kinds: str = "", seed: str = "0") -> dict[str, Any]:
    """Faults tried, survived and lost, by command and kind.

    Args:
        rounds: Faults by each signal.
        only: Names of commands, separated by commas; all if empty.
        kinds: The same of signals and other faults.
        seed: Of the moments.
    """
    figures: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as name:
        root = Path(name)
        commands = {command.name: command for command in prepare(root)}
        wanted = [kind for kind in chosen([*SIGNALS, *FAULTS], kinds) if possible(kind, root)]
        for each in chosen([*commands], only):
            reference = undisturbed(commands[each], root)
            for kind in wanted:
                rng, count = random.Random(f"{seed} {each} {kind}"), Count()
                for wrong in faults(kind, reference, int(rounds), rng, root):
                    count.add(wrong)
                figures[f"{each}, {kind}"] = str(count)
                print(f"{each}, {kind}: {count}", flush=True)
    return figures


def chosen(names: list[str], asked: str) -> list[str]:
    """Those asked for, or all.

    Raises:
        UserError: If there is none of a name.
    """
    given = asked.split(",") if asked else names
    if unknown := [name for name in given if name not in names]:
        raise UserError(f"There is no {', '.join(unknown)}; choose from {', '.join(names)}.")
    return given


def possible(kind: str, root: Path) -> bool:
    """Whether this process may do it; says so if not."""
    if FAULTS.get(kind) not in MOUNTED or can_mount(root):
        return True
    print(f"{kind}: left out, as only root can mount a file system for it.", flush=True)
    return False


def faults(
    kind: str, reference: Reference, rounds: int, rng: random.Random, root: Path
) -> Iterator[str | None]:
    """Try faults of one kind; yields what went wrong with each."""
    if kind in FAULTS:
        yield from FAULTS[kind](reference, root, rng)
    else:
        for _ in range(rounds):
            yield fault(reference, signal.Signals[kind], rng, root)


def undisturbed(command: Command, root: Path) -> Reference:
    """Run a command twice and watch its files appear.

    Raises:
        RuntimeError: If it fails, or the second run has other results than the first.
    """
    clear(command)
    import_what_it_imports(command.arguments, root / "log")
    first = contents(command)
    clear(command)
    begin, seen = time.monotonic(), dict[str, None]()
    running = Running(command.arguments, root / "log")
    running.wait(lambda: seen.update(dict.fromkeys(files(*command.products))) or False)
    seconds = time.monotonic() - begin
    reference = Reference(command, seconds, list(seen), first)
    if wrong := difference(running.end(), reference):
        raise RuntimeError(f"{command.name} does not repeat itself undisturbed: {wrong}")
    return reference


def fault(
    reference: Reference, number: signal.Signals, rng: random.Random, root: Path
) -> str | None:
    """End a command once and run it again; gives what went wrong."""
    command = reference.command
    for _ in range(MAX_TRIES):
        clear(command)
        running = Running(command.arguments, root / "log")
        when, until = moment(reference, rng)
        if running.wait(until):
            running.send(number)
            break
        running.end()
    else:
        raise RuntimeError(f"{command.name} was always quicker than the moments.")
    ended = running.end()
    wrong = badly_ended(ended, number) or difference(
        run(command.arguments, root / "log"), reference
    )
    return wrong and f"{when}: {wrong}"


def moment(reference: Reference, rng: random.Random) -> tuple[str, Callable[[], bool]]:
    """A moment to end a command at, in words and as a condition."""
    begin = time.monotonic()
    if rng.random() < 0.5:
        after = rng.uniform(0, reference.seconds)
        return f"after {after:.2f} s", lambda: time.monotonic() - begin > after
    name, after = rng.choice(reference.appearing), rng.uniform(0, AFTER_S)
    appeared: list[float] = []

    def until() -> bool:
        if not appeared and name in files(*reference.command.products):
            appeared.append(time.monotonic())
        return bool(appeared) and time.monotonic() - appeared[0] > after

    return f"{1000 * after:.0f} ms after {name}", until


def badly_ended(ended: Ended, number: signal.Signals) -> str | None:
    """What is wrong with the way in which a process ended."""
    if "Traceback" in ended.said or "Error" in ended.said:
        return f"it said {ended.said[-2000:]}"
    fine = {0, -number} if number == signal.SIGKILL else {0, INTERRUPTED}
    if number == signal.SIGTERM:
        fine.add(-number)
    if ended.status not in fine:
        return f"it ended with status {ended.status} and said {ended.said[-2000:]}"
    return None
