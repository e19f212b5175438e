"""How many of the listed one-line faults the tests find.

``python -m benchmarks mutants``, or ``--only=3,14`` for some of them. The list in
``mutants.txt`` was picked by hand, mostly from lines that compute or decide, and shuffled with the
seed 0: an end that is off by one, a swapped axis, a wrong sign, another sample's label. Each is put
into a copy of the checkout, and the test files that belong to the module run until the first
failure. A line is found by its content, and by a part of its path where several are alike; one
that there is no longer counts as gone, and one whose tests take too long as undecided.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
SECONDS = 400  # for the tests of one fault
FAULTS = Path(__file__).with_suffix(".txt").read_text(encoding="utf-8").splitlines()


def measure(only: str = "", tree: str = str(ROOT)) -> dict[str, Any]:
    """Count the faults that tests found, and name those that they did not.

    Args:
        only: Numbers of faults, separated by commas; else all.
        tree: The checkout that is tested.
    """
    found: dict[str, list[int]] = {"caught": [], "survived": [], "undecided": [], "gone": []}
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "copy"
        shutil.copytree(tree, copy, ignore=shutil.ignore_patterns(".git", ".*_cache", "outputs"))
        for number in map(int, only.split(",") if only else range(len(FAULTS))):
            outcome = _try(copy, FAULTS[number])
            found[outcome].append(number)
            print(number, outcome, FAULTS[number], file=sys.stderr, flush=True)
    return {
        **{name: len(numbers) for name, numbers in found.items()},
        "surviving": {str(number): FAULTS[number] for number in found["survived"]},
    }


def _try(copy: Path, fault: str) -> str:
    old, new = fault.split(" ==> ")
    hint, old = re.fullmatch(r"(?:([a-z_/]+): )?(.*)", old).groups()  # type: ignore[union-attr]
    texts = {path: path.read_text() for path in sorted(copy.glob("tex_lightning/**/*.py"))}
    having = [path for path, text in texts.items() if old in text]
    if not having:
        return "gone"
    module = max(having, key=lambda path: f"tex_lightning/{hint}" in path.as_posix())
    module.write_text(texts[module].replace(old, new, 1))
    try:
        return _judge(copy, module)
    finally:
        module.write_text(texts[module])


def _judge(copy: Path, module: Path) -> str:
    """What the tests of a module say: its own file first, then its package's and users'."""
    name = ".".join(module.relative_to(copy).with_suffix("").parts)
    package = copy / "tests" / module.parent.name
    using = re.compile(rf"{re.escape(name)}\b")
    files = [path for path in copy.glob("tests/**/test_*.py") if using.search(path.read_text())]
    own = package / f"test_{module.stem}.py"
    files = sorted({*files, *package.glob("test_*.py")}, key=lambda path: (path != own, path))
    command = ["-m", "pytest", "-q", "-x", "-n0", "-pno:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": f"{copy}:{copy / 'runtime'}", "OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, *command, *map(str, files)],
            cwd=copy, env=environment, capture_output=True, timeout=SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "undecided"
    return "caught" if done.returncode else "survived"
