"""Commands that are killed at any moment go on to the same results.

``python -m benchmarks faults --rounds=5``

Each command runs undisturbed, then is killed ``rounds`` times at a moment uniform over the seconds
that this took, and run again as it was. Weights and votes have to be equal to the last bit.
"""

import os
import random
import signal
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

from benchmarks._commands import command, environment, run
from benchmarks.digests import SURFACES, TINY, digests_of

COMMANDS = {
    "fit": ("model=fusion", *SURFACES, *TINY),
    "crossval": ("task=crossval", "crossval.only=[0,1]", "model=haptic", *SURFACES, *TINY),
}


def measure(rounds: str = "3", seed: str = "0") -> dict[str, Any]:
    """By command how often it was killed, and in what its results differ then."""
    moments, figures = random.Random(int(seed)), {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        drawn = ("task=generate", "data.classes=3", f"generate.out={folder / 'surfaces'}")
        run(folder, "generate", (*drawn, "debug=tiny", "data.synthetic.recordings=10"))
        for case, given in COMMANDS.items():
            arguments = [each.format(surfaces=folder / "surfaces") for each in given]
            begin = time.perf_counter()
            run(folder, case, arguments)
            seconds, lost = time.perf_counter() - begin, []
            for number in range(int(rounds)):
                again = f"{case}_{number}"
                _kill(command(folder, again, arguments), folder, moments.uniform(0, seconds))
                run(folder, again, arguments)
                lost += _differences(folder / "runs" / case, folder / "runs" / again)
            figures[case] = {"killed": int(rounds), "differ": ", ".join(lost) or "none"}
    return figures


def _kill(arguments: list[str], folder: Path, after: float) -> None:
    process = subprocess.Popen(
        arguments, cwd=folder, env=environment(), start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    time.sleep(after)
    if process.poll() is None:
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _differences(whole: Path, again: Path) -> list[str]:
    folders = [".", *(str(each.relative_to(whole)) for each in whole.glob("folds/*"))]
    return [
        f"{name}/{key}"
        for name in folders
        for key, digest in digests_of(whole / name).items()
        if digests_of(again / name).get(key) != digest
    ]
