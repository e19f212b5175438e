"""Every command and every piece of Python in the documentation runs, page by page.

``python -m pytest -m slow -n 0 tests/test_docs_run.py`` runs all; it needs the extras ``dev``,
``docs``, ``imagenet`` and ``parallel``. Budgets are those of ``debug=tiny``, and what a page names
(:mod:`docs_world`) is small.
"""

import os
import re
import runpy
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import make_photo, make_trace
from docs_world import (
    enter_page,
    write_shared,
    write_surfaces,
    write_web_runtime,
    write_weights,
)
from documentation import MULTIRUN, PAGES, ROOT, Block, blocks, commands, package_arguments
from haptic_sets import write_tum

import tex_lightning as tl
from benchmarks.__main__ import names as benchmarks
from tex_lightning.config.search import use_config_dir
from tex_lightning.export import web_page as web_runtime
from tex_lightning_runtime.__main__ import main as runtime_main

# What no test can run, by a part of the command, with the reason.
NOT_RUN = {
    ".venv": "installs from the network; .ci/run does",
    "pip install": "installs from the network; .ci/run does",
    "python -m pytest": "these tests",
    "ruff check": "the lint step of .ci/run",
    "ruff format": "the lint step of .ci/run",
    "mypy": "the lint step of .ci/run",
    "lint-imports": "the lint step of .ci/run",
    "npm pack": "fetches from the network; a stand-in lies there",
    "http.server": "serves until it is stopped",
    "hydra/launcher=submitit_slurm": "needs a SLURM cluster",
    "srun": "needs a SLURM cluster; tests/learning trains in two processes",
    "task=record": "needs a sensor; tests/recording runs",
    "docs/draw_networks.py": "writes into the checkout; tests/test_docs.py compares what it makes",
    "python -m benchmarks": "measures for minutes; the name is checked",
}
WEIGHTS = {
    "ALEXNET.caffemodel": "alexnet_caffe",
    "VGG_M.caffemodel": "vgg_m",
}
ELSEWHERE = {"extend.md": "plugin", "data_sets.md": "data/readers"}
RUNNABLE = [page for page in PAGES if page.name not in ELSEWHERE]


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    """``../shared`` of the pages, and what they add classes from."""
    root = write_shared(tmp_path_factory.mktemp("pages") / "shared")
    write_surfaces(root / "new", "GH", "haptic", "image", recordings=3, side=2 * 224)
    return root


@pytest.fixture(scope="module")
def trained(world, run_once) -> Path:
    """A run folder of a FusionNet that was trained for a few steps."""
    data = ("data=folder", f"data.root={world / 'data' / 'all'}")
    return run_once("model=fusion", *data, "debug=tiny")


@pytest.fixture
def enter(world, trained, cache, tmp_path, monkeypatch) -> Iterator[Callable[[Path], Path]]:
    """Go to the folder of a page, with what pages name in it."""
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: str(cache))
    digest = write_web_runtime(cache / f"{web_runtime.NAME}-{web_runtime.VERSION}.tgz")
    monkeypatch.setattr(web_runtime, "INTEGRITY", digest)

    def go(page: Path) -> Path:
        folder = world.parent / page.stem
        written = " ".join(command for _, command in commands(page))
        makes_its_own = re.search(r"hydra\.(run|sweep)\.dir=RUN\b", written)
        enter_page(folder, world, None if makes_its_own else trained)
        monkeypatch.chdir(folder)
        return folder

    yield go
    use_config_dir([])


def special(page: Path, folder: Path) -> dict[str, str]:
    """Put what few pages name into the folder of one; gives replacements of its words."""
    text = page.read_text(encoding="utf-8")
    words = {
        file: str(write_weights(folder / f"{trunk}.npz", trunk))
        for file, trunk in WEIGHTS.items()
        if file in text
    }
    if "data.root=TUM" in text:
        write_tum(folder / "TUM", classes=3, seconds=4, side=480)
    if page.name == "deploy.md":
        write_web_runtime(folder / f"{web_runtime.NAME}-{web_runtime.VERSION}.tgz")
    return words


def small(arguments: list[str]) -> list[str]:
    """The same in seconds: tiny budgets, one fold, two jobs of a sweep, two perturbations."""
    given = " ".join(arguments)
    more = [] if "debug=tiny" in arguments else ["debug=tiny"]
    if (
        re.search(r"task=crossval|experiment=(table|paper)/", given)
        and "crossval.only" not in given
    ):
        more.append("crossval.only=[0]")
    if not re.search(r"data=|data\.classes|checkpoint=|stability", given):
        more.append("data.classes=3")  # of the synthetic surfaces
    if "task=stability" in given and "stability.only" not in given:
        more.append("stability.only=[white_noise,jpeg]")
    if "optuna" in given:
        more.append("hydra.sweeper.n_trials=2")
    for table, models in (("table/haptic", "haptic,mfcc_nb"), ("paper/all", "haptic,vgg_m_fv")):
        if f"experiment={table}" in given:
            more.append(f"hydra.sweeper.params.model='{models}'")
    if any(each in arguments for each in MULTIRUN):
        arguments = [_two_jobs(each) for each in arguments]
    return [*arguments, *more]


def _two_jobs(argument: str) -> str:
    key, _, value = argument.partition("=")
    choices = re.split(r",(?![^\[{(]*[\]})])", value)
    if key == "seed" and len(choices) == 5:  # the next command reads all five
        return argument
    if len(choices) > 2 and not value.startswith(("[", "{", "tag")):
        return f"{key}={choices[0]},{choices[-1]}"
    return re.sub(r"range\(0,\d+\)", "range(0,2)", argument)


def names_of_python() -> dict[str, Any]:
    """What pieces of Python take for granted: arrays, and the package under its short name."""
    trace = make_trace(0, 0, 12.0)[None]  # also long at another rate
    chunks = np.array_split(trace, 20, axis=1)
    frame = make_photo(0, 0, 2 * 224)
    return {"tl": tl, "samples": trace, "frame": frame, "chunks": chunks, "chunk": trace}


def run_python(block: Block, names: dict[str, Any]) -> None:
    """Run a piece of Python with the names of those before it."""
    exec(compile(block.text, f"{block.page}:{block.line}", "exec"), names)


class Reader:
    """Runs the blocks of one page in order."""

    def __init__(self, page: Path, folder: Path, cli, monkeypatch) -> None:
        self.folder, self.cli, self.monkeypatch = folder, cli, monkeypatch
        self.words = special(page, folder)
        self.filled = {}
        for block, command in commands(page):
            self.filled.setdefault(block, []).append(command)
        self.names = names_of_python()

    def run(self, block: Block) -> None:
        """Run a block.

        Raises:
            AssertionError: If one of its commands fails.
        """
        if block.language == "python":
            run_python(block, self.names)
        elif block.language == "bash":
            for command in self.filled.get(block, []):
                self.shell(command)
        elif named := re.match(r"# (conf/\S+\.yaml)$", block.text, re.MULTILINE):
            path = self.folder / named[1]
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text, encoding="utf-8")

    def shell(self, command: str) -> None:
        """Run a command, or note why it is not."""
        for word, value in self.words.items():
            command = command.replace(word, value)
        for part in NOT_RUN:
            if part in command:
                assert "benchmarks" not in part or set(command.split()[3:]) <= {*benchmarks()}
                return
        arguments = package_arguments(command)
        if arguments is not None:
            self.package(arguments, re.search(r"< (\S+)$", command))
        elif command.startswith("sphinx-build"):
            (self.folder / "docs").symlink_to(ROOT / "docs")
            subprocess.run([sys.executable, "-m", "sphinx", *shlex.split(command)[1:]], check=True)
        elif command.startswith("python docs/"):
            script, *given = shlex.split(command)[1:]
            self.monkeypatch.setattr(sys, "argv", [script, *given])
            runpy.run_path(str(ROOT / script), run_name="__main__")
        else:
            program, *given = shlex.split(command)
            assert program == "tex-runtime", command
            self.monkeypatch.setattr(sys, "argv", [program, *given])
            assert runtime_main() == 0

    def package(self, arguments: list[str], source: re.Match[str] | None) -> None:
        """Run the command line of the package."""
        with Path(source[1] if source else os.devnull).open(encoding="latin1") as standard_input:
            self.monkeypatch.setattr(sys, "stdin", standard_input)
            outcome = self.cli(*small(arguments))
        assert outcome.status == 0, outcome.err[-3000:]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Deprecated API features:DeprecationWarning")  # SQLAlchemy 1.4
@pytest.mark.parametrize("page", RUNNABLE, ids=lambda page: page.name)
def test_a_page_runs_from_top_to_bottom(page, enter, cli, monkeypatch, capfd):
    failed = []
    reader = Reader(page, enter(page), cli, monkeypatch)
    for block in blocks(page):
        try:
            reader.run(block)
        except (Exception, SystemExit) as error:  # the other blocks are looked at, too
            failed.append(f"{block.page}:{block.line}: {type(error).__name__}: {error}")
    assert not failed, "\n\n".join(failed)
