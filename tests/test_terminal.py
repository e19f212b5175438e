"""Whole runs in a pseudo-terminal: what a person sees while they go on, and what is left."""

import re
import sys

import pytest
from terminal import Session, run_in_terminal

TINY = ("debug=tiny", "data.classes=3", "trainer.threads=1")
FRONTIER = "frontier.only=[hapticnet_w0.125,minirocket_1000]"
RUNS = {
    "fit": ("model=fusion",),
    "crossval": ("task=crossval", "crossval.only=[0,3]"),
    "frontier": ("task=frontier", FRONTIER),
    "sweep": ("-m", "seed=0,1"),
}
SIZES = [(80, 24), (120, 40)]


def run(cache, folder, arguments, columns=80, rows=24, **more) -> Session:
    kind = "sweep" if "-m" in arguments else "run"
    given = [*arguments, *TINY, f"data.cache_dir={cache}", f"hydra.{kind}.dir={folder}"]
    command = [sys.executable, "-m", "tex_lightning", *given]
    return run_in_terminal(command, columns, rows, OMP_NUM_THREADS="1", **more)


def without_paths(text: str) -> list[str]:
    """Lines, but for what ends with a path or is a command to copy, which only a terminal wraps."""
    return [row for row in text.splitlines() if "/" not in row and "python -m" not in row]


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
@pytest.mark.parametrize(("columns", "rows"), SIZES)
def test_bars_that_go_away_and_a_table_that_fits(cache, tmp_path, name, columns, rows):
    session = run(cache, tmp_path / "run", RUNS[name], columns, rows)
    assert session.status == 0, session.screen.text
    assert not session.screen.cursor_is_hidden
    raw = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", session.screen.raw)
    written = [row for row in re.split("[\r\n]+", raw) if row]
    assert max(map(len, without_paths("\n".join(written)))) <= columns
    assert session.screen.drawn
    text = session.screen.text
    assert not {*text} & {"╸", "╺"}
    assert "…" not in text
    assert re.search(r"\d\.\d%", text)
    assert text.splitlines()[-1]


@pytest.mark.slow
def test_jobs_side_by_side_are_told_apart_and_draw_nothing(cache, tmp_path):
    sweep = ("-m", "model=haptic", "seed=0,1", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2")
    session = run(cache, tmp_path / "run", sweep)
    assert session.status == 0, session.screen.text
    assert session.screen.drawn == []
    text = session.screen.text
    for job in "01":
        assert f"] Job {job}: Fold 0, haptic network: " in text
    assert "2 seeds" in text


@pytest.mark.slow
def test_an_interrupted_run_leaves_whole_lines_and_the_cursor(cache, tmp_path):
    arguments = ("task=crossval", "model.haptic.fit.epochs=400")
    session = run(cache, tmp_path / "run", arguments, interrupt_at="epoch 9/400")
    assert session.status == 130
    assert not session.screen.cursor_is_hidden
    text = session.screen.text
    assert "epoch" not in text.partition("Interrupted")[0]
    assert " ".join(text.partition("Interrupted")[2].split()).endswith(
        "goes on after the last finished epoch."
    )
