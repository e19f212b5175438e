"""The commands and the Python of the documentation run, page by page.

``python -m pytest -m slow -n 0 tests/test_docs_run.py`` runs all; it needs the extras ``dev`` and
``imagenet``. Budgets are those of ``debug=tiny``, of a sweep the first job runs, and what a page
names (:mod:`docs_world`) is small. Commands of reports are composed by ``tests/test_docs.py``.
"""

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import make_photo, make_trace, own_arrays
from docs_world import WEIGHTS, lay_out, write_surfaces, write_web_runtime
from documentation import (
    MULTIRUN,
    ROOT,
    USER_PAGES,
    blocks,
    commands,
    package_arguments,
    sweep_jobs,
)

import tex_lightning as tl
from tex_lightning.export import web_page
from tex_lightning_runtime.__main__ import main as runtime_main

NOT_RUN = {
    "task=record": "needs a sensor; tests/recording runs",
    "adapt": "needs a network that was fitted at once; tests/tasks/test_adapt.py runs it",
    "srun": "needs a SLURM cluster; tests/learning trains in two processes",
}
ELSEWHERE = ("extend.md", "data_sets.md")  # tests/plugin and tests/data/readers run them
PAGES = [ROOT / "README.md", *(page for page in USER_PAGES if page.name not in ELSEWHERE)]


@pytest.fixture(scope="module")
def world(tmp_path_factory) -> Path:
    """Recordings that pages name: six classes, and two that are added."""
    root = tmp_path_factory.mktemp("pages")
    write_surfaces(root / "all", "ABCDEF", "haptic", "image", "sound")
    write_surfaces(root / "new", "GH", "haptic", "image", recordings=3)
    return root


@pytest.fixture(scope="module")
def trained(world, run_once) -> Path:
    """A run folder of a FusionNet that was trained for a few steps."""
    return run_once("model=fusion", "data=folder", f"data.root={world / 'all'}", "debug=tiny")


def small(arguments: list[str]) -> list[str]:
    """The same in seconds: tiny budgets, one fold, one job of a sweep, two perturbations."""
    if any(flag in arguments for flag in MULTIRUN):
        arguments = sweep_jobs([item for item in arguments if item not in MULTIRUN])
    given, more = " ".join(arguments), [] if "debug=tiny" in arguments else ["debug=tiny"]
    if re.search(r"task=crossval|experiment=(table|paper)/", given):
        more.append("crossval.only=[0]")
    if not re.search(r"data=|data\.classes|checkpoint=|stability", given):
        more.append("data.classes=3")  # of the synthetic surfaces
    if "task=stability" in given:
        more.append("stability.only=[white_noise,jpeg]")
    for table, models in (("table/haptic", "haptic,mfcc_nb"), ("paper/all", "haptic,vgg_m_fv")):
        if f"experiment={table}" in given:
            more.append(f"hydra.sweeper.params.model='{models}'")
    return [*arguments, *more]


def run_shell(command: str, cli, monkeypatch: pytest.MonkeyPatch) -> None:
    """Run a command of this package or its runtime; others install or check something."""
    for file, trunk in WEIGHTS.items():
        command = command.replace(file, f"{trunk}.npz")
    arguments = package_arguments(command)
    if arguments is not None and not any(part in command for part in NOT_RUN):
        outcome = cli(*small(arguments))
        assert outcome.status == 0, outcome.err[-3000:]
    elif command.startswith("tex-runtime "):
        monkeypatch.setattr(sys, "argv", shlex.split(command))
        assert runtime_main() == 0


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_runs_from_top_to_bottom(page, world, trained, cache, cli, monkeypatch, tmp_path):
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: str(cache))
    digest = write_web_runtime(cache / f"{web_page.NAME}-{web_page.VERSION}.tgz")
    monkeypatch.setattr(web_page, "INTEGRITY", digest)
    lay_out(tmp_path, page, world, trained)
    monkeypatch.chdir(tmp_path)
    trace, frame = make_trace(0, 0, 12.0)[None], make_photo(0, 0, 2 * 224)
    chunks = np.array_split(trace, 20, axis=1)
    names = {"tl": tl, "samples": trace, "frame": frame, "chunks": chunks, "chunk": trace}
    names |= own_arrays()
    shell: dict[object, list[str]] = {}
    for block, command in commands(page):
        shell.setdefault(block, []).append(command)
    for block in blocks(page):
        if block.language == "python":
            exec(compile(block.text, f"{page.name}:{block.line}", "exec"), names)
        for command in shell.get(block, []):
            run_shell(command, cli, monkeypatch)
